/* Switches: where forces or outputs change their branch.
 *
 * Within a step every switch keeps its mode, the sign of its switching function, so that the rates are smooth in a step. If a switching
 * function changes its sign, the step is repeated so that it ends at the zero; then passing.c changes the mode. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* Relative difference of rates below which they do not jump. Rates do not jump either if their difference would move the state over the
 * whole motion by less than NEGLIGIBLE tolerances: where a force starts, as in q < 0 ? abs(q)^1.3 : 0, its size is determined by
 * rounding. */
static const scalar SAME = 1e-13, NEGLIGIBLE = 1e-6;

/* A switching function counts as zero at the start if it would be zero within this fraction of the motion's duration. A function that
 * is constant, such as abs(x) - x where x > 0, counts as zero if it is smaller than the second number, a rounding error. */
static const scalar AT_ZERO = 1e-13, ROUNDED = 1e-12;

/* Fraction of the motion's duration after which a motion that begins at rest at a switch has left it. */
static const scalar MOMENT = 1e-8;

/* Relative difference of a switching function's rates before and after a knot of the inputs below which they are the same. */
static const scalar SAME_SPEED = 1e-9;

enum { FEW_REFUSED = 3 };

/* Largest number of passes over switches whose functions depend on the modes of other switches. */
enum { PASSES = 8 };

static const scalar TURN_OF_A_STEP = 2.0; /* rad */

static scalar sign_of(scalar x) { return (x > 0.0) - (x < 0.0); }

static const scalar HALF_A_TURN = 3.14159265358979323846;

/* Distance of a switch from the change of its mode, positive on the side of the mode. */
scalar ordernm_side(const ordernm_motion *m, int k)
{
    const scalar x = m->switches[k];
    if (m->modes[k] == 0.0) return LEAST_SIDE; /* not held */
    return m->system->switch_kind[k] == ORDERNM_TURN ? HALF_A_TURN*HALF_A_TURN - x*x : m->modes[k]*x;
}

/* The mode after a switch, or the mode of the state if it is already beyond the switch. */
scalar ordernm_other_mode(const ordernm_motion *m, int k)
{
    if (m->system->switch_kind[k] == ORDERNM_TURN) return m->switches[k] > 0.0 ? -HALF_A_TURN : HALF_A_TURN;
    return -m->modes[k];
}

/* Whether a switching function with this rate is zero at the start. */
static int is_zero_at_start(const ordernm_motion *m, scalar value, scalar speed)
{
    return fabs(value) <= fmax(AT_ZERO*(m->problem->end - m->problem->start)*fabs(speed), speed == 0.0 ? ROUNDED : 0.0);
}

/* The mode of the state, from the switching function evaluated without a mode. */
static scalar mode_of(const ordernm_motion *m, int k)
{
    const scalar x = m->switches[k];
    if (m->system->switch_kind[k] == ORDERNM_TURN) return x != 0.0 ? x : LEAST_SIDE;
    return sign_of(x);
}

/* Whether the rates of this motion, or outputs with events, depend on a switch. */
int ordernm_matters(const ordernm_motion *m, int k)
{
    const ordernm_system *const s = m->system;
    const ordernm_problem *const p = m->problem;
    int found = s->drives[k];
    for (int i = 0; i < s->nswitch_outputs && !found; ++i) {
        if (s->switch_of_output[2*i] != k) continue;
        const int output = s->switch_of_output[2*i + 1];
        for (int n = 0; n < m->nx; ++n) found |= p->integrals[n] == output;
        for (int n = 0; n < p->nevents; ++n) found |= p->events[n].output == output;
    }
    return found;
}

/* Selects the switches whose modes are held; singular functions have no mode. */
void ordernm_hold_switches(ordernm_motion *m)
{
    const ordernm_system *const s = m->system;
    for (int k = 0; k < s->nswitches; ++k)
        if (s->switch_kind[k] != ORDERNM_POINT && ordernm_matters(m, k)) m->held[m->nheld++] = k;
}

/* All switching functions at a state, with the current modes. Returns the status of a function. */
int ordernm_switching(ordernm_motion *m, scalar t, const scalar *z)
{
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    int status = ordernm_close_loops(m, &c);
    if (status) ordernm_arguments(m, t, z, &c); /* a loop has lost rank: uses the predicted state */
    c.switches = m->switches;
    return ORDERNM_VALUES_OF(m, switches)(&c);
}

/* Rate of a switching function along rates of the state. Returns the status of a function. */
int ordernm_switch_speed(ordernm_motion *m, scalar t, const scalar *z, const scalar *rate, int k, scalar *found)
{
    ordernm_call c;
    int status = ordernm_along_time(m, t, z, rate, &c);
    if (status) return status;
    c.switches = m->switches, c.dswitches = m->dswitches;
    status = ORDERNM_OF(m, switch_sensitivities[ORDERNM_ONE])(&c);
    *found = m->dswitches[k];
    return status;
}

/* The switch that determines the time of a crossed switch, and the rate of its function. This is the crossed switch itself, unless another
 * switch crossed at the same time makes the function zero, as in sign(max(0, x)): then it is the other switch. Returns the status of a
 * function. */
int ordernm_timing_switch(ordernm_motion *m, scalar t, const scalar *z, const scalar *rate, const scalar *crossed, int k, scalar *speed,
    int *by)
{
    int status = ordernm_switch_speed(m, t, z, rate, k, speed);
    *by = k;
    if (status || *speed != 0.0 || fabs(m->switches[k]) > ROUNDED) return status;
    for (int i = k - 1; i >= 0 && *by == k; --i)
        if (crossed[i] != 0.0) *by = i;
    return *by == k ? 0 : ordernm_switch_speed(m, t, z, rate, *by, speed);
}

/* Derivatives of a switching function along all directions at a fixed time, LANES numbers for each group. */
int ordernm_switch_along(ordernm_motion *m, scalar t, const scalar *z, int k)
{
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    int status = ordernm_close_loops(m, &c);
    for (int n = 0; n < m->ngroups && !status; ++n) {
        const group *const g = m->groups + n;
        ordernm_seeds(m, t, z, g, &c);
        c.switches = m->switches, c.dswitches = m->dswitches;
        status = ORDERNM_OF(m, switch_sensitivities[g->index])(&c);
        memcpy(m->switch_along + n*LANES, m->dswitches + (long)k*g->width, g->width*sizeof(scalar));
    }
    return status;
}

/* Whether a switching function is zero within a fraction of the motion's duration, and its rate. Returns the status of a function. */
static int is_at_zero(ordernm_motion *m, scalar t, const scalar *z, int k, scalar fraction, scalar *speed, int *at_zero)
{
    const int status = ordernm_switch_speed(m, t, z, m->rate[0], k, speed);
    *at_zero = fabs(m->switches[k]) <= fraction*(m->problem->end - m->problem->start)*fabs(*speed);
    return status;
}

/* Gives a mode to switch k if it has none and its function leaves zero when another switch is passed. For example, max(0, x) > 0 changes
 * when x > 0 does. The mode is the sign of the function after the other switch is passed. Returns the status of a function. */
static int leave_zero(ordernm_motion *m, scalar t, const scalar *z, int k)
{
    scalar speed;
    int at_zero;
    if (m->modes[k] != 0.0 || m->let_go[k] != 0.0 || m->system->switch_kind[k] > ORDERNM_ROOT) return 0;
    const int status = is_at_zero(m, t, z, k, AT_ZERO, &speed, &at_zero);
    if (!status && at_zero) m->modes[k] = sign_of(speed);
    return status;
}

/* Sets the mode of a switch that is not crossed to the sign of its function, which has been evaluated. Returns the status of a function. */
static int follow_function(ordernm_motion *m, scalar t, const scalar *z, const scalar *crossed, int k)
{
    if (!(ordernm_side(m, k) < 0.0)) return leave_zero(m, t, z, k);
    const scalar other = ordernm_other_mode(m, k);
    scalar speed;
    int at_zero = 0, status = 0;
    if (crossed && m->system->switch_kind[k] <= ORDERNM_ROOT) status = is_at_zero(m, t, z, k, AT_THE_SAME_TIME, &speed, &at_zero);
    if (!at_zero) m->modes[k] = other;
    return status;
}

/* Sets the mode of each switch that is not crossed to the sign of its function, unless this sign is unknown. A function that is zero at the
 * same time as those of the crossed switches keeps its mode: the next step passes it, with its jump of derivatives. Functions depend on the
 * modes of switches with smaller indices, so they are evaluated again until no mode changes. */
int ordernm_follow(ordernm_motion *m, scalar t, const scalar *z, const scalar *crossed)
{
    int status = 0, changed = 1;
    for (int pass = 0; pass < PASSES && changed && !status; ++pass) {
        changed = 0;
        status = ordernm_switching(m, t, z);
        for (int i = 0; i < m->nheld && !status; ++i) {
            const int k = m->held[i];
            const scalar mode = m->modes[k];
            if (crossed && crossed[k] != 0.0) continue;
            status = follow_function(m, t, z, crossed, k);
            changed |= m->modes[k] != mode && m->system->switch_kind[k] <= ORDERNM_ROOT;
        }
    }
    return status;
}

/* Whether a switching function, which has been evaluated, has jumped away from zero. Returns the status of a function. */
static int has_left_zero(ordernm_motion *m, int k, scalar before, int *left)
{
    scalar speed;
    int status = 0, at_zero = 1;
    const int jumps = m->system->switch_kind[k] <= ORDERNM_ROOT && fabs(m->switches[k] - before) > ROUNDED + fabs(before);
    if (jumps) status = is_at_zero(m, m->t, m->z, k, AT_THE_SAME_TIME, &speed, &at_zero);
    *left = !status && !at_zero;
    return status;
}

/* Removes switches whose functions have jumped away from zero, because the mode of switch k has changed: at the seam of a periodic table,
 * these are all switches that compare its reduced argument. Those in m->crossed take the modes of their functions. Those in
 * m->together were passed before switch k, as in every perturbed motion. `before` contains the functions for the old mode of switch k.
 * Returns the status of a function. */
int ordernm_remove_jumped(ordernm_motion *m, int k, const scalar *before, int *left)
{
    int kept = 0, jumped = 0, status = ordernm_switching(m, m->t, m->z);
    for (int j = k + 1; j < m->system->nswitches && !status; ++j) {
        if (m->crossed[j] == 0.0) continue;
        if ((status = has_left_zero(m, j, before[j], &jumped)) || !jumped) continue;
        m->crossed[j] = 0.0;
        m->changed[j] = m->t;
        --*left;
    }
    for (int i = 0; i < m->ntogether && !status; ++i) {
        const int j = m->together[i];
        if (j != k && (status = has_left_zero(m, j, before[j], &jumped))) break;
        if (j == k || !jumped) m->together[kept++] = j;
    }
    if (!status) m->ntogether = kept;
    return status;
}

int ordernm_rates_jump(const ordernm_motion *m, const scalar *before, const scalar *after)
{
    const ordernm_problem *const p = m->problem;
    for (int i = 0; i < m->ny + m->nx; ++i) {
        const scalar by = fabs(before[i] - after[i]);
        if (by > SAME*(fabs(before[i]) + fabs(after[i])) && by*(p->end - p->start) > NEGLIGIBLE*p->atol[i]) return 1;
    }
    return 0;
}

/* Values of switching functions at the start of a step, times the sign that each mode requires. */
int ordernm_sides(ordernm_motion *m, scalar t, const scalar *z, scalar *sides)
{
    const int status = ordernm_switching(m, t, z);
    for (int i = 0; i < m->nheld; ++i) {
        const scalar side = ordernm_side(m, m->held[i]);
        sides[i] = side > LEAST_SIDE ? side : LEAST_SIDE;
    }
    return status;
}

/* Sets the mode of a switch whose function is zero at the start, with a zero rate. If the motion leaves this zero to the same side with
 * both modes, the mode is the sign of the function on that side; otherwise 0. Returns 0, or SLIDES if both modes drive the motion back. */
static int choose_from_rest(ordernm_motion *m, scalar t, const scalar *z, int k)
{
    const scalar duration = m->problem->end - m->problem->start, moment = MOMENT*duration;
    scalar *const rate = m->trial, *const later = m->error[0];
    scalar way[2];
    int status = 0;
    for (int n = 0; n < 2 && !status; ++n) {
        m->modes[k] = 2*n - 1;
        status = ordernm_rates_of(m, t, z, rate, 0, 0, RATES);
        memcpy(later, z, m->size*sizeof(scalar));
        for (int i = 0; i < m->ny; ++i) later[i] += moment*rate[i];
        if (!status) status = ordernm_rates_of(m, t + moment, later, rate, 0, 0, RATES);
        if (!status) status = ordernm_switch_speed(m, t + moment, later, rate, k, way + n);
    }
    m->modes[k] = 0.0;
    if (status || fmin(fabs(way[0]), fabs(way[1]))*duration <= ROUNDED*MOMENT) return 0; /* such small rates are rounding errors */
    if (sign_of(way[0]) == sign_of(way[1])) m->modes[k] = sign_of(way[0]);
    else if (way[0] > 0.0) m->results->component = k;
    return way[0] > 0.0 && way[1] < 0.0 ? SLIDES : 0;
}

/* Sets the mode of a switch. Where its function is zero, its rates with all modes are compared. Returns 0, the status of a function, or
 * SLIDES with the switch in the results. */
static int choose_mode(ordernm_motion *m, scalar t, const scalar *z, int k)
{
    scalar *const rate = m->trial;
    int status = ordernm_switching(m, t, z); /* with the modes so far: after a jump of one function, later functions jump too */
    if (status) return status;
    const scalar g = m->switches[k];
    if (m->system->switch_kind[k] > ORDERNM_ROOT) {
        m->modes[k] = mode_of(m, k);
        return 0;
    }
    const int side = g > 0.0 ? 1 : -1; /* with the other branch of prescribed motion, loops may not close */
    scalar way[3]; /* with the modes -1, 0, 1 */
    for (int n = 0; n < 3; ++n) {
        const int mode = n == 0 ? side : n == 1 ? 0 : -side;
        m->modes[k] = mode;
        if ((status = ordernm_rates_of(m, t, z, rate, 0, 0, RATES))) return status;
        if ((status = ordernm_switch_speed(m, t, z, rate, k, way + 1 + mode))) return status;
        if (n == 0 && !is_zero_at_start(m, g, way[1 + side])) return 0;
    }
    if (way[2] >= 0.0 && way[0] >= 0.0 && way[2] + way[0] > 0.0) m->modes[k] = 1.0;
    else if (way[2] <= 0.0 && way[0] <= 0.0 && way[2] + way[0] < 0.0) m->modes[k] = -1.0;
    else if (way[0] == 0.0 && way[1] == 0.0 && way[2] == 0.0) return choose_from_rest(m, t, z, k);
    else if (way[1] == 0.0) m->modes[k] = 0.0; /* rests at the switch */
    else if (way[2] < 0.0) {
        m->results->component = k;
        return SLIDES;
    } else m->modes[k] = 1.0;
    return 0;
}

/* The modes at the start. Returns 0, the status of a function, or SLIDES. */
int ordernm_choose_modes(ordernm_motion *m, scalar t, const scalar *z)
{
    for (int k = 0; k < m->system->nswitches; ++k) m->modes[k] = 0.0, m->changed[k] = -INFINITY;
    for (int i = 0; i < m->nheld; ++i) {
        const int status = choose_mode(m, t, z, m->held[i]);
        if (status) return status;
    }
    memset(m->crossed, 0, m->system->nswitches*sizeof(scalar));
    return 0;
}

/* Whether rates differ between the modes of a switch. */
static int modes_differ(ordernm_motion *m, int k)
{
    const scalar mode = m->modes[k];
    scalar *const one = m->error[0], *const other = m->error[1];
    if (ordernm_rates_of(m, m->t, m->z, one, 0, 0, RATES | INTEGRALS)) return 0;
    m->modes[k] = ordernm_other_mode(m, k);
    const int status = ordernm_rates_of(m, m->t, m->z, other, 0, 0, RATES | INTEGRALS);
    m->modes[k] = mode;
    return !status && ordernm_rates_jump(m, one, other);
}

/* Whether the function of a switch with a mode is zero where the motion begins; finds its rate. */
int ordernm_begins_at_zero(ordernm_motion *m, int k, scalar *speed)
{
    if (m->modes[k] == 0.0 || ordernm_switch_speed(m, m->t, m->z, m->rate[0], k, speed)) return 0;
    const scalar x = m->switches[k], value = m->system->switch_kind[k] == ORDERNM_TURN ? HALF_A_TURN - fabs(x) : x;
    return is_zero_at_start(m, value, *speed);
}

/* Whether the motion begins at the zero of a switch with a mode, and rates jump there. */
int ordernm_begins_at_jump(ordernm_motion *m, int k)
{
    scalar speed;
    return ordernm_begins_at_zero(m, k, &speed) && modes_differ(m, k);
}

/* Whether errors of the state may pass a switch with a mode, and rates jump there; errors of switching functions must be known. */
int ordernm_errs_past_jump(ordernm_motion *m, int k)
{
    if (m->modes[k] == 0.0 || m->system->switch_kind[k] > ORDERNM_ROOT || ordernm_switching(m, m->t, m->z)) return 0;
    return fabs(m->switches[k]) <= ordernm_switch_error(m, k) && modes_differ(m, k);
}

/* Gives switches the modes of a motion just before its start, and stores those of the start in m->modes_before. Functions are evaluated in
 * several passes, because those that jump at the start, as mod does at the seam of a table, move the zeros of other functions. */
int ordernm_modes_before_start(ordernm_motion *m)
{
    const ordernm_system *const s = m->system;
    scalar *const before = m->switches_kept, speed;
    const size_t size = s->nswitches*sizeof(scalar);
    int status = 0, changed = 1;
    memcpy(m->modes_before, m->modes, size);
    for (int pass = 0; pass < PASSES && changed && !status; ++pass) {
        memcpy(before, m->modes, size);
        for (int i = 0; i < m->nheld; ++i) {
            const int k = m->held[i];
            const int zero = ordernm_begins_at_zero(m, k, &speed);
            if (zero && s->switch_kind[k] == ORDERNM_TURN) before[k] = m->modes_before[k] == m->modes[k] ? ordernm_other_mode(m, k) : m->modes[k];
            else if (zero) before[k] = speed > 0.0 ? -1.0 : speed < 0.0 ? 1.0 : -m->modes_before[k];
            else if (m->modes[k] != 0.0 && ordernm_side(m, k) < 0.0) before[k] = ordernm_other_mode(m, k);
        }
        changed = memcmp(m->modes, before, size) != 0;
        memcpy(m->modes, before, size);
        status = ordernm_switching(m, m->t, m->z);
    }
    return status;
}

/* A switching function has an extremum at zero, at the state in m->trial: there are no derivatives if rates jump there. */
void ordernm_touch(ordernm_motion *m, scalar t, int k)
{
    const scalar mode = m->modes[k];
    scalar *const one = m->error[0], *const other = m->error[1];
    if (ordernm_rates_of(m, t, m->trial, one, 0, 0, RATES | INTEGRALS)) return;
    m->modes[k] = -mode;
    const int status = ordernm_rates_of(m, t, m->trial, other, 0, 0, RATES | INTEGRALS);
    m->modes[k] = mode;
    if (!status && ordernm_rates_jump(m, one, other)) m->results->grazed = k + 1;
}

/* Held rates may be undefined after a switch, such as the root of a negative number. If smaller steps have not helped, a step is made
 * without held modes, in the actual branches of its states. Returns whether to make such a step. */
int ordernm_let_go(ordernm_motion *m)
{
    int held = 0;
    if (++m->not_held < FEW_REFUSED) return 0;
    for (int i = 0; i < m->nheld; ++i) held |= m->modes[m->held[i]] != 0.0;
    for (int i = 0; i < m->nheld; ++i) {
        const int k = m->held[i];
        if (m->modes[k] != 0.0) m->let_go[k] = m->modes[k];
        m->modes[k] = 0.0;
    }
    m->not_held = 0;
    return held && !ordernm_rates(m, m->t, m->z, m->rate[0]);
}

/* Holds the modes again after a step without held modes. Returns the status of a function. */
int ordernm_hold_again(ordernm_motion *m)
{
    int status = 0, any = 0;
    const int *const kind = m->system->switch_kind;
    for (int i = 0; i < m->nheld; ++i) {
        const int k = m->held[i];
        any |= m->changed[k] < m->t && (m->modes[k] == 0.0 || kind[k] == ORDERNM_TURN);
    }
    if (!any || (status = ordernm_switching(m, m->t, m->z))) return status;
    for (int i = 0; i < m->nheld; ++i) {
        const int k = m->held[i];
        if (!(m->changed[k] < m->t)) continue;
        const int free = m->modes[k] == 0.0;
        scalar speed = 1.0;
        if (free && kind[k] <= ORDERNM_ROOT && m->switches[k] != 0.0 && fabs(m->switches[k]) <= ROUNDED
            && (status = ordernm_switch_speed(m, m->t, m->z, m->rate[0], k, &speed))) return status;
        if (speed == 0.0) continue;
        if (free || kind[k] == ORDERNM_TURN) m->modes[k] = mode_of(m, k); /* reference angles are those near the start of the step */
        m->switched |= free && m->modes[k] != 0.0;
        if (kind[k] <= ORDERNM_ROOT && m->let_go[k]*m->modes[k] < 0.0) m->results->not_held = k + 1;
        m->let_go[k] = 0.0;
    }
    return 0;
}

/* Limits the step size by the rates of half-turn angles. Returns the status of a function. */
int ordernm_limit_turns(ordernm_motion *m)
{
    m->turning = 0.0;
    for (int i = 0; i < m->nheld; ++i) {
        if (m->system->switch_kind[m->held[i]] != ORDERNM_TURN) continue;
        scalar speed;
        const int status = ordernm_switch_speed(m, m->t, m->z, m->rate[0], m->held[i], &speed);
        if (status) return status;
        const scalar longest = TURN_OF_A_STEP/fabs(speed);
        if (longest < INFINITY && (m->turning == 0.0 || longest < m->turning)) m->turning = longest;
    }
    return 0;
}

/* Before a knot of the inputs: rates of the switching functions that are zero there. Returns the status of a function. */
int ordernm_arrive_at_knot(ordernm_motion *m)
{
    int status = 0;
    for (int i = 0; i < m->nheld && !status; ++i) {
        const int k = m->held[i];
        if (m->modes[k] == 0.0 || fabs(m->crossing[m->problem->nevents + i]) > ROUNDED) continue;
        status = ordernm_switch_speed(m, m->t, m->z, m->rate[0], k, m->speeds + k);
    }
    return status;
}

/* Where a switching function is zero at a knot of the inputs: compares its rates before and after the knot. If they differ, and rates of
 * the state jump at the switch, the switch is added to m->bent. `stays`: the function remains zero. Returns the status of a function. */
static int bend_at_knot(ordernm_motion *m, int k, int *stays)
{
    scalar speed;
    int status = ordernm_rates_of(m, m->t, m->z, m->trial, 0, 0, RATES);
    if (!status) status = ordernm_switch_speed(m, m->t, m->z, m->trial, k, &speed);
    const int bends = !status && fabs(speed - m->speeds[k]) > SAME_SPEED*(fabs(speed) + fabs(m->speeds[k]));
    if (bends && modes_differ(m, k)) m->bent[m->nbent++] = k;
    *stays = bends && speed == 0.0;
    return status;
}

/* At a knot of the inputs, switching functions may jump. The time of the knot has no derivatives. If a function jumps to zero, as that of
 * gate >= 1 does when `gate` becomes 1, or stays at zero after the knot, its mode is chosen as at the start. Returns 0, the status of a
 * function, or SLIDES. */
int ordernm_follow_inputs(ordernm_motion *m)
{
    int status = ordernm_follow(m, m->t, m->z, 0);
    m->nbent = 0;
    for (int i = 0; i < m->nheld && !status; ++i) {
        const int k = m->held[i];
        int anew = 1;
        if (m->system->switch_kind[k] > ORDERNM_ROOT || m->let_go[k] != 0.0) continue;
        if (m->modes[k] == 0.0 && fabs(m->switches[k]) > ROUNDED) m->modes[k] = sign_of(m->switches[k]); /* leaves zero */
        if (m->modes[k] == 0.0 || fabs(m->switches[k]) > ROUNDED) continue;
        if (fabs(m->crossing[m->problem->nevents + i]) <= ROUNDED) status = bend_at_knot(m, k, &anew);
        if (!status && anew) status = choose_mode(m, m->t, m->z, k);
        if (!status) status = ordernm_switching(m, m->t, m->z);
    }
    return status;
}

/* ---- Rows of steps. ---- */

/* Stores modes in a row of steps, and whether the switches have just been crossed. */
void ordernm_keep_modes(const ordernm_motion *m, scalar *row)
{
    const int n = m->system->nswitches;
    for (int k = 0; k < n; ++k) row[k] = m->modes[k], row[n + k] = m->crossed[k] != 0.0;
}

/* Modes from a row of steps. */
void ordernm_take_modes(ordernm_motion *m, const scalar *row)
{
    const int n = m->system->nswitches;
    for (int k = 0; k < n; ++k) m->modes[k] = row[k], m->crossed[k] = row[n + k];
}

/* Takes the modes before or after switch k of those crossed at the start of a step, which are passed in their order. `before` are the modes
 * before all of them; the step's row contains those after them. */
void ordernm_modes_beside(ordernm_motion *m, const scalar *row, const scalar *before, int k, int after)
{
    const int n = m->system->nswitches;
    int last = 1;
    for (int i = k + 1; i < n; ++i) last &= row[n + i] == 0.0;
    for (int i = 0; i < n; ++i) m->modes[i] = (after && last) || (i < k + after && row[n + i] != 0.0) ? row[i] : before[i];
}
