/* Directions along which the motion has no derivative from a time on, although the motion itself continues.
 *
 * There are six causes: derivatives of rates that are not finite, as for sqrt(abs(x)) where x stays at zero; a switch at which the motion
 * rests, while perturbed motions use the branch on either side; singular points, see points.c; jumps of rates without a known switch, as
 * for atan2(y, x) where both arguments are zero; a start at a switch with a jump, on either side of which perturbed motions start; and such
 * a switch at a knot of the inputs, if the rate of its function changes there. Lost directions are NaN in results, zero in the state. */
#include "radau.h"

#include <math.h>
#include <string.h>

/* Relative difference below which derivatives of rates on the two sides of a switch count as equal. */
static const scalar AGREE = 1e-10;

/* A direction moves a switch if the relative motion of the switch exceeds this limit; residues of passed switches are smaller. */
static const scalar MOVES = 1e-7;

/* Fraction of the motion's duration within which a result is at the time of a switch. */
static const scalar SAMPLED = 1e-12;

/* Replaces MOVES for switches at the start of the motion, and for results at a switch at its end: only rounding errors occur there. */
static const scalar ROUNDED = 1e-12;

/* A jump of a rate is suspected if the change between neighbouring stages is at least PART_OF_STEP of all changes in the step. The jump is
 * confirmed if at least PART_OF_CHANGE of the change remains after all bisections, exceeds PART_OF_RATE of the rate, and would move the
 * state by ERRORS_ALLOWED tolerances over the whole motion. The search covers the SUSPECTS steps after a rejected one, and every step of
 * constant size. */
enum { SUSPECTS = 4 };
static const scalar PART_OF_STEP = 0.5, PART_OF_CONSTANT_STEP = 0.8, PART_OF_CHANGE = 0.25, PART_OF_RATE = 1e-9, ERRORS_ALLOWED = 10.0;

static void clear(const ordernm_motion *m, const group *g, int lane, scalar *z)
{
    for (long i = 0; i < m->ny + m->nx; ++i) z[g->at + i*g->width + lane] = 0.0;
}

static void lose(ordernm_motion *m, int n, int lane)
{
    const group *const g = m->groups + n;
    scalar *const states[] = {m->z, m->next, m->rate[0], m->rate[m->method->stages]};
    m->lost[n*LANES + lane] = NAN;
    for (int i = 0; i < 4; ++i) clear(m, g, lane, states[i]);
    for (int i = 0; i < m->system->np; ++i) g->dp[i*g->width + lane] = 0.0;
    for (int i = 0; i < STAGES && m->radau; ++i) clear(m, g, lane, m->radau->stage[i]), clear(m, g, lane, m->radau->last[i]);
}

/* Records in the results which directions are lost, and the reason; from then on, results along these directions are NaN. */
static void note(ordernm_motion *m, int why, int which)
{
    ordernm_results *const r = m->results;
    if (r->lost_count == r->lost_capacity) return;
    const long size = ordernm_row_size(m->problem);
    scalar *const row = r->lost + r->lost_count*size;
    memset(row, 0, size*sizeof(scalar));
    if (ordernm_report(m, m->t, m->z, row)) row[0] = m->t;
    r->lost_why[2*r->lost_count] = why;
    r->lost_why[2*r->lost_count++ + 1] = which;
}

/* Marks directions as lost whose derivatives are not finite in a state or in rates. */
void ordernm_lose_infinite(ordernm_motion *m, const scalar *z)
{
    int some = 0;
    if (!m->ngroups || ordernm_all_finite(z + m->values, m->size - m->values)) return;
    for (int n = 0; n < m->ngroups; ++n)
        for (int l = 0; l < m->groups[n].width; ++l) {
            const group *const g = m->groups + n;
            if (ordernm_finite_along(z + g->at, m->ny + m->nx, g->width, l)) continue;
            some |= l < g->used && m->lost[n*LANES + l] == 0.0;
            lose(m, n, l);
        }
    if (some) note(m, ORDERNM_INFINITE, 0);
}

/* ---- Rest at switches. ---- */

/* Finds the switches whose functions are zero at both ends of the step. Returns their number. */
static int resting(ordernm_motion *m, scalar end)
{
    int count = 0;
    for (int i = 0; i < m->nheld; ++i) {
        const int k = m->held[i];
        if (m->modes[k] == 0.0 && m->let_go[k] == 0.0 && m->system->switch_kind[k] <= ORDERNM_ROOT) m->resting[count++] = k;
    }
    for (int at = 0; at < 2 && count; ++at) {
        const int found = count;
        count = 0;
        if (ordernm_switching(m, at ? m->t : end, at ? m->z : m->next)) return 0;
        for (int i = 0; i < found; ++i)
            if (m->switches[m->resting[i]] == 0.0) m->resting[count++] = m->resting[i];
    }
    return count;
}

/* Whether two sets of rates differ, in values or in derivatives along a direction. */
static int differ(const ordernm_motion *m, const group *g, int lane, const scalar *a, const scalar *b)
{
    scalar largest = 0.0, apart = 0.0;
    if (ordernm_rates_jump(m, a, b)) return 1;
    for (long i = 0; i < m->ny + m->nx; ++i) {
        const long at = g->at + i*g->width + lane;
        largest = fmax(largest, fmax(fabs(a[at]), fabs(b[at])));
        if (!(fabs(a[at] - b[at]) <= apart)) apart = fabs(a[at] - b[at]);
    }
    return !(apart <= AGREE*largest);
}

/* Rates along all groups; the mode of a resting switch is the sign of the change of its function along a direction, times `side`. */
static int on_a_side(ordernm_motion *m, int count, scalar side, scalar *rates)
{
    for (int i = 0; i < count; ++i) m->modes[m->resting[i]] = side*m->speeds[i];
    const int status = ordernm_rates_of(m, m->t, m->z, rates, m->ngroups, m->groups, RATES | INTEGRALS);
    for (int i = 0; i < count; ++i) m->modes[m->resting[i]] = 0.0;
    return status;
}

/* Where this motion rests at a switch, a perturbed motion leaves the switch to one side. Along a direction there is a derivative only if
 * the rates on both sides agree with the rates at rest. */
static void look_at_rest(ordernm_motion *m, scalar end)
{
    scalar *const rest = m->at_pose, *const one = m->error[0], *const other = m->error[1];
    const int count = resting(m, end);
    int which = -1, known = 0;
    if (count && !m->ngroups && !m->results->lost_count) note(m, ORDERNM_RESTS, m->resting[0]);
    for (int n = 0; count && n < m->ngroups; ++n)
        for (int l = 0; l < m->groups[n].used; ++l) {
            int leaves = -1;
            if (m->lost[n*LANES + l] != 0.0) continue;
            for (int i = 0; i < count; ++i) {
                if (ordernm_switch_along(m, m->t, m->z, m->resting[i])) return;
                const scalar x = m->switch_along[n*LANES + l];
                m->speeds[i] = (x > 0.0) - (x < 0.0);
                if (x != 0.0) leaves = m->resting[i];
            }
            if (leaves < 0) continue;
            /* for a single switch, both sides are the same for all directions */
            if (!known && (on_a_side(m, count, 0.0, rest) || on_a_side(m, count, 1.0, one) || on_a_side(m, count, -1.0, other))) return;
            known = count == 1;
            if (!differ(m, m->groups + n, l, rest, one) && !differ(m, m->groups + n, l, rest, other)) continue;
            lose(m, n, l);
            which = leaves;
        }
    if (which >= 0) note(m, ORDERNM_RESTS, which);
}

/* ---- Jumps without a switch. ---- */

/* The change of a rate, in tolerances over the whole motion. */
static scalar change(const ordernm_motion *m, int i, scalar a, scalar b)
{
    const ordernm_problem *const p = m->problem;
    const scalar by = fabs(a - b);
    return by > PART_OF_RATE*(fabs(a) + fabs(b)) ? (p->end - p->start)*by/(p->atol[i] + p->rtol*fabs(m->z[i])) : 0.0;
}

/* Sorts the stages and the end of the step by time, and keeps only the last of simultaneous stages. Returns the number of places. */
static int sort_stages(const ordernm_motion *m, int *order)
{
    const scalar *const times = m->method->times;
    const int stages = m->method->stages;
    int count = 0;
    for (int i = 0; i < stages; ++i) {
        int at = i;
        for (; at > 0 && times[order[at - 1]] > times[i]; --at) order[at] = order[at - 1];
        order[at] = i;
    }
    for (int i = 0; i < stages; ++i)
        if (times[order[i]] < (i + 1 < stages ? times[order[i + 1]] : 1.0)) order[count++] = order[i];
    order[count] = stages;
    return count + 1;
}

/* The neighbouring stages with the largest change of a rate; returns its fraction of all changes in the step. */
static scalar widest_pair(const ordernm_motion *m, const int *order, int points, int i, int *widest)
{
    scalar largest = 0.0, all = 0.0;
    for (int k = 0; k < points - 1; ++k) {
        const scalar by = fabs(m->rate[order[k]][i] - m->rate[order[k + 1]][i]);
        all += by;
        if (by > largest) largest = by, *widest = k;
    }
    return all > 0.0 ? largest/all : 0.0;
}

/* Rates at a state on the cubic through the ends of the step; 0 if the rates are undefined. */
static scalar *rates_within(ordernm_motion *m, scalar h, scalar x, scalar *rates)
{
    if (x == 0.0 || x == 1.0) return m->rate[x == 0.0 ? 0 : m->method->stages];
    ordernm_between(m, h, x, m->trial);
    if (ordernm_rates_of(m, m->t + x*h, m->trial, rates, 0, 0, RATES | INTEGRALS)) return 0;
    return m->nd && m->results->condition_here > m->poor ? 0 : rates; /* a loop loses rank there */
}

/* Bisects intervals with a change above the smallest jump. Returns whether a rate jumps between two places, and which rate. */
static int jumps_between(ordernm_motion *m, scalar h, scalar from, scalar to, const scalar *low, const scalar *high, int halved, int *which)
{
    const scalar *const least = m->halves[HALVES], middle = 0.5*(from + to);
    int i = 0;
    while (i < ordernm_counted(m) && !(change(m, i, low[i], high[i]) > least[i])) ++i;
    *which = i;
    if (i == ordernm_counted(m) || halved == HALVES) return i < ordernm_counted(m);
    const scalar *const here = rates_within(m, h, middle, m->halves[halved]);
    return here && (jumps_between(m, h, from, middle, low, here, halved + 1, which)
                    || jumps_between(m, h, middle, to, here, high, halved + 1, which));
}

/* Returns whether a rate jumps within the step, and which rate. Each rate is compared with its own changes, since other rates may change
 * far more. Times before and after the largest change between stages are also searched, because stages are not exactly on the motion. */
static int jumps(ordernm_motion *m, scalar h, int *which)
{
    const scalar part = m->adaptive ? PART_OF_STEP : PART_OF_CONSTANT_STEP;
    int order[MOST_STAGES];
    const int points = sort_stages(m, order);
    unsigned places = 0;
    for (int i = 0, n = ordernm_counted(m); i < n; ++i) {
        int k = 0;
        const scalar share = widest_pair(m, order, points, i, &k), by = change(m, i, m->rate[order[k]][i], m->rate[order[k + 1]][i]);
        const int suspect = share >= part && by > ERRORS_ALLOWED;
        m->halves[HALVES][i] = suspect ? fmax(PART_OF_CHANGE*by, ERRORS_ALLOWED) : INFINITY;
        if (suspect) places |= 7u << k >> 1;
    }
    for (int n = 0; n < points - 1; ++n) {
        const scalar from = m->method->times[order[n]], to = n < points - 2 ? m->method->times[order[n + 1]] : 1.0;
        if (!(places >> n & 1u)) continue;
        const scalar *const low = rates_within(m, h, from, m->error[0]), *const high = rates_within(m, h, to, m->error[1]);
        if (low && high && jumps_between(m, h, from, to, low, high, 0, which)) return 1;
    }
    return 0;
}

static int is_moved(const ordernm_motion *m, int n, int lane)
{
    const group *const g = m->groups + n;
    const ordernm_inputs *const in = &m->problem->inputs;
    const long count = in->directions ? in->count*ordernm_signals(m->system) : 0;
    int moved = 0;
    for (long i = 0; i < m->ny + m->nx; ++i) moved |= m->z[g->at + i*g->width + lane] != 0.0;
    for (int i = 0; i < m->system->np; ++i) moved |= g->dp[i*g->width + lane] != 0.0;
    for (long i = 0; i < count; ++i) moved |= in->directions[(g->first + lane)*count + i] != 0.0;
    return moved;
}

/* Marks all directions as lost after a jump of rates without a switch, because the derivative of the jump's time is unknown. */
static void look_for_jump(ordernm_motion *m, scalar h)
{
    int which = 0, some = !m->ngroups && !m->results->lost_count;
    if (!jumps(m, h, &which)) return;
    for (int n = 0; n < m->ngroups; ++n)
        for (int l = 0; l < m->groups[n].used; ++l)
            if (m->lost[n*LANES + l] == 0.0 && is_moved(m, n, l)) lose(m, n, l), some = 1;
    if (some) note(m, ORDERNM_JUMPS, which);
}

/* Looks for singular points in the step. Marks directions as lost along which no derivative exists after such a point, or for which this is
 * unknown because rates near the point are not defined. Without directions, records the first such point. */
static void look_at_points(ordernm_motion *m, const trial *step)
{
    point at = {.which = -1};
    while (ordernm_next_point(m, step, &at)) {
        int some = !m->ngroups && !m->results->lost_count;
        const int unknown = m->ngroups && ordernm_look_at_point(m, step->h, &at);
        for (int n = 0; n < m->ngroups; ++n)
            for (int l = 0; l < m->groups[n].used; ++l) {
                if (m->lost[n*LANES + l] != 0.0 || !is_moved(m, n, l)) continue;
                if (unknown || ordernm_rates_are_rough(m, step->h, &at) || ordernm_lost_at_point(m, step->h, &at, n, l))
                    lose(m, n, l), some = 1;
            }
        if (some) note(m, ORDERNM_PASSES, at.which);
    }
}

/* Change, along a direction, of the switching function whose derivatives are in m->switch_along, relative to the size of the direction. */
static scalar moves_switch(const ordernm_motion *m, const scalar *z, int n, int lane)
{
    const group *const g = m->groups + n;
    scalar size = 0.0;
    for (long i = 0; i < m->ny + m->nx; ++i) size = fmax(size, fabs(z[g->at + i*g->width + lane]));
    for (int i = 0; i < m->system->np; ++i) size = fmax(size, fabs(g->dp[i*g->width + lane]));
    return size > 0.0 ? fabs(m->switch_along[n*LANES + lane])/size : 0.0;
}

/* If derivatives of rates are unbounded at a switch, directions that move the switch are lost. */
static void look_at_powers(ordernm_motion *m, const trial *step)
{
    const int k = ordernm_growing_power(m, step);
    int some = !m->ngroups && !m->results->lost_count;
    const scalar *const rate = m->rate[m->method->stages];
    scalar speed, fastest = 0.0;
    if (k < 0 || ordernm_switch_speed(m, step->end, m->next, rate, k, &speed)) return;
    if (ordernm_switch_along(m, step->end, m->next, k)) return;
    for (int i = 0; i < m->ny; ++i) fastest = fmax(fastest, fabs(rate[i]));
    for (int n = 0; n < m->ngroups; ++n)
        for (int l = 0; l < m->groups[n].used; ++l)
            if (m->lost[n*LANES + l] == 0.0 && moves_switch(m, m->next, n, l)*fastest > MOVES*fabs(speed)) lose(m, n, l), some = 1;
    if (some) note(m, ORDERNM_PASSES, k);
}

/* Updates the smallest and the largest time by which each direction shifts a zero at the start of the motion. */
static void add_shifts(ordernm_motion *m)
{
    for (int j = 0; j < m->nheld; ++j) {
        const int k = m->held[j];
        scalar speed;
        if (!ordernm_begins_at_zero(m, k, &speed) || ordernm_switch_along(m, m->t, m->z, k)) continue;
        for (int n = 0; n < m->ngroups; ++n)
            for (int i = n*LANES; i < n*LANES + m->groups[n].used; ++i) {
                const scalar along = m->switch_along[i], time = along == 0.0 ? 0.0 : along/speed;
                m->switch_time[i] = fmin(m->switch_time[i], time);
                m->passing_time[i] = fmax(m->passing_time[i], time);
            }
    }
}

/* Whether a direction shifts all zeros at the start of the motion by the same time. Zeros at rest are shifted by an infinite time; see
 * add_shifts. */
static int shifts_alike(const ordernm_motion *m, int i)
{
    const scalar first = m->switch_time[i], last = m->passing_time[i], size = fabs(first) + fabs(last);
    return size < INFINITY && last - first <= AGREE*size;
}

/* Whether rates are the same at the start and just before it. Finds the shifts in time, along each direction, of all zeros at the start,
 * in the modes of both sides. */
static int begins_smoothly(ordernm_motion *m)
{
    scalar *const before = m->error[0], *const after = m->error[1];
    for (int i = 0; i < m->ngroups*LANES; ++i) m->switch_time[i] = INFINITY, m->passing_time[i] = -INFINITY;
    add_shifts(m);
    int status = ordernm_modes_before_start(m);
    if (!status) add_shifts(m);
    if (!status) status = ordernm_rates_of(m, m->t, m->z, before, 0, 0, RATES | INTEGRALS);
    memcpy(m->modes, m->modes_before, m->system->nswitches*sizeof(scalar));
    if (!status) status = ordernm_rates_of(m, m->t, m->z, after, 0, 0, RATES | INTEGRALS);
    return !status && !ordernm_rates_jump(m, before, after);
}

/* Marks directions as lost that move a switch whose function is zero, for the given reason. With `smooth`, directions that shift all such
 * zeros alike are not lost. */
static void lose_at_switch(ordernm_motion *m, int k, int why, int smooth)
{
    int some = !m->ngroups && !m->results->lost_count;
    if (ordernm_switch_along(m, m->t, m->z, k)) return;
    for (int n = 0; n < m->ngroups; ++n)
        for (int l = 0; l < m->groups[n].used; ++l)
            if (m->lost[n*LANES + l] == 0.0 && moves_switch(m, m->z, n, l) > (why == ORDERNM_BENDS ? MOVES : ROUNDED) && !(smooth && shifts_alike(m, n*LANES + l)))
                lose(m, n, l), some = 1;
    if (some) note(m, why, k);
}

/* Marks directions as lost that move a switch at which the motion begins, if rates jump there. At a point of a smooth table, several
 * switches change together, and rates jump only where they are shifted apart. */
void ordernm_lose_at_start(ordernm_motion *m)
{
    int smooth = -1;
    for (int i = 0; i < m->nheld && (m->ngroups || m->results->lost); ++i) {
        if (!ordernm_begins_at_jump(m, m->held[i])) continue;
        if (smooth < 0) smooth = begins_smoothly(m);
        lose_at_switch(m, m->held[i], ORDERNM_BEGINS, smooth);
    }
}

/* Without directions, records that derivatives may not exist because of a switch at which the motion begins. */
void ordernm_doubt_start(ordernm_motion *m, int k)
{
    if (!m->ngroups && !m->results->lost_count) note(m, ORDERNM_BEGINS, k);
}

/* Marks directions as lost that move a switch with a jump whose function is zero at a knot of the inputs, and changes its rate there. */
void ordernm_lose_at_knot(ordernm_motion *m)
{
    for (int i = 0; i < m->nbent && (m->ngroups || m->results->lost); ++i) lose_at_switch(m, m->bent[i], ORDERNM_BENDS, 0);
    m->nbent = 0;
}

/* ---- Results at the time of a switch. ---- */

/* Time by which errors of the state may move the switches passed last. */
static scalar moved_by_errors(ordernm_motion *m)
{
    scalar time = 0.0;
    if (!m->ntogether || ordernm_find_switch_errors(m, m->t, m->z)) return 0.0;
    for (int i = 0; i < m->ntogether; ++i) {
        const int k = m->together[i];
        if (m->speeds[k] != 0.0) time = fmax(time, ordernm_switch_error(m, k)/fabs(m->passing_speed[k]));
    }
    return time;
}

/* Whether a result is wanted within a given time of the current one. */
static int is_sampled(const ordernm_motion *m, scalar within)
{
    const ordernm_problem *const p = m->problem;
    const scalar near = fmax(SAMPLED*(p->end - p->start), within);
    const int before = m->sampled > 0 && fabs(p->times[m->sampled - 1] - m->t) <= near;
    return p->ntimes && (before || (m->sampled < p->ntimes && p->times[m->sampled] - m->t <= near));
}

/* Whether a direction jumps at the switches just passed. */
static int jumps_along(const ordernm_motion *m, int n, int lane)
{
    const group *const g = m->groups + n;
    for (long i = 0; i < m->ny + m->nx; ++i) {
        const scalar here = m->z[g->at + i*g->width + lane], first = m->z_before[g->at + i*g->width + lane];
        if (fabs(here - first) > AGREE*(fabs(here) + fabs(first))) return 1;
    }
    return 0;
}

/* A switch with a jump of rates for which one of two conditions holds: the motion ends at the switch's zero without crossing the zero, or
 * errors of the state may decide whether the motion crosses the zero. -1 if there is no such switch. */
static int ends_at_switch(ordernm_motion *m)
{
    if (m->t < m->problem->end || ordernm_find_switch_errors(m, m->t, m->z)) return -1;
    for (int i = 0; i < m->nheld; ++i) {
        const int k = m->held[i];
        if (m->crossed[k] == 0.0 && (ordernm_begins_at_jump(m, k) || ordernm_errs_past_jump(m, k))) return k;
    }
    return -1;
}

/* At the time of a switch, derivatives of results are those of one side. Records the directions for which both sides differ: derivatives
 * along these directions are NaN in the recorded row. */
void ordernm_look_at_samples(ordernm_motion *m)
{
    ordernm_results *const r = m->results;
    const ordernm_system *const s = m->system;
    if (r->lost_capacity - r->lost_count <= m->problem->ndirections) return; /* leaves memory for lost directions */
    const int passed = m->switched && m->together_jump && m->ntogether;
    if (!is_sampled(m, passed ? moved_by_errors(m) : 0.0)) return;
    const int end = ends_at_switch(m);
    const long first = 1 + s->nq + s->nu + s->noutputs + m->nx;
    int some = !m->ngroups && !r->lost_count;
    if ((end < 0 && !passed) || (end >= 0 && ordernm_switch_along(m, m->t, m->z, end))) return;
    scalar *const row = r->lost + r->lost_count*ordernm_row_size(m->problem);
    int which = end;
    for (int i = 0; i < m->ntogether && end < 0; ++i)
        if (which < 0 || m->speeds[m->together[i]] != 0.0) which = m->together[i];
    note(m, ORDERNM_SAMPLED, which);
    for (int n = 0; n < m->ngroups; ++n)
        for (int l = 0; l < m->groups[n].used; ++l) {
            if (m->lost[n*LANES + l] != 0.0) continue;
            if (!(passed && jumps_along(m, n, l)) && !(end >= 0 && moves_switch(m, m->z, n, l) > ROUNDED)) continue;
            row[first + (m->groups[n].first + l)*s->nq] = NAN;
            some = 1;
        }
    if (!some) --r->lost_count;
}

/* Marks directions as lost that have no derivative after this step. */
void ordernm_look_for_lost(ordernm_motion *m, const trial *step)
{
    const scalar condition = m->results->condition_here;
    if (!m->ngroups && !m->results->lost) return;
    look_at_rest(m, step->end);
    if (m->nheld) look_at_powers(m, step);
    if (m->npoints) look_at_points(m, step);
    if (m->rejected_before || m->jumps_at_end || !m->adaptive) m->suspects = SUSPECTS;
    if (m->suspects > 0 && step->event < 0 && !m->beside_power) look_for_jump(m, step->h);
    m->suspects -= m->suspects > 0;
    m->results->condition_here = condition;
}
