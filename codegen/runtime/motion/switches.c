/* Switches: where forces or outputs change their branch.
 *
 * Within a step every switch keeps its mode, the sign of its switching function, so that the rates are smooth in a step. If a
 * switching function changes its sign, the step is repeated so that it ends there; then passing.c changes the mode. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* Rates that differ by less, relative to their size, do not jump, nor do rates whose difference would move the state over the whole motion
 * by less than this part of the error allowed: where a force begins, as q < 0 ? abs(q)^1.3 : 0 does, rounding decides how large it is. */
static const scalar SAME = 1e-13, NEGLIGIBLE = 1e-6;

/* As near to zero at the beginning, in the time of the motion, a switching function is taken as zero; one that does not change, such as
 * abs(x) - x where x > 0, is zero but for this rounding. */
static const scalar AT_ZERO = 1e-13, ROUNDED = 1e-12;

enum { FEW_REFUSED = 3 };

static const scalar TURN_OF_A_STEP = 2.0; /* rad */

static scalar sign_of(scalar x) { return (x > 0.0) - (x < 0.0); }

static const scalar HALF_A_TURN = 3.14159265358979323846;

/* How far a switch is from where its mode changes, positive on the side of the mode. */
scalar ordernm_side(const ordernm_motion *m, int k)
{
    const scalar x = m->switches[k];
    if (m->modes[k] == 0.0) return LEAST_SIDE; /* it is let go */
    return m->system->switch_kind[k] == ORDERNM_TURN ? HALF_A_TURN*HALF_A_TURN - x*x : m->modes[k]*x;
}

/* The mode behind the place where a switch changes it, or where it is by the state when it is beyond. */
scalar ordernm_other_mode(const ordernm_motion *m, int k)
{
    if (m->system->switch_kind[k] == ORDERNM_TURN) return m->switches[k] > 0.0 ? -HALF_A_TURN : HALF_A_TURN;
    return -m->modes[k];
}

/* The mode by the state, from the switching function without a mode. */
static scalar mode_of(const ordernm_motion *m, int k)
{
    const scalar x = m->switches[k];
    if (m->system->switch_kind[k] == ORDERNM_TURN) return x != 0.0 ? x : LEAST_SIDE;
    return sign_of(x);
}

/* Whether the rates of this motion depend on a switch, or outputs that events are of. */
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

/* The modes of these are held; singular functions have none. */
void ordernm_hold_switches(ordernm_motion *m)
{
    const ordernm_system *const s = m->system;
    for (int k = 0; k < s->nswitches; ++k)
        if (s->switch_kind[k] != ORDERNM_POINT && ordernm_matters(m, k)) m->held[m->nheld++] = k;
}

/* All switching functions at a state, in the modes at hand. Returns what a function returned. */
int ordernm_switching(ordernm_motion *m, scalar t, const scalar *z)
{
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    int status = ordernm_close_loops(m, &c);
    if (status) ordernm_arguments(m, t, z, &c); /* where a loop has lost rank, as the step has predicted */
    c.switches = m->switches;
    return ORDERNM_VALUES_OF(m, switches)(&c);
}

/* How fast a switching function changes along rates. Returns what a function returned. */
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

/* The switch by whose function the time of a crossed one follows, and how fast that changes: itself; but where its function is zero behind
 * another one that is crossed there, as that of sign(max(0, x)) is, that one. Returns what a function returned. */
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

/* The derivatives of a switching function along all directions at a fixed time, LANES numbers for each group. */
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

/* A switch without a mode, whose function has been zero and leaves zero where another one changes its mode: max(0, x) > 0 where x > 0 does.
 * It has the mode that the function goes to. Returns what a function returned. */
static int leave_zero(ordernm_motion *m, scalar t, const scalar *z, int k)
{
    scalar speed;
    if (m->modes[k] != 0.0 || m->let_go[k] != 0.0 || m->system->switch_kind[k] > ORDERNM_ROOT) return 0;
    const int status = ordernm_switch_speed(m, t, z, m->rate[0], k, &speed);
    const int at_zero = fabs(m->switches[k]) <= AT_ZERO*(m->problem->end - m->problem->start)*fabs(speed);
    if (!status && at_zero) m->modes[k] = sign_of(speed);
    return status;
}

/* Gives switches other than those crossed the modes that their functions have. Those of which nobody knows the side stay. */
int ordernm_follow(ordernm_motion *m, scalar t, const scalar *z, const scalar *crossed)
{
    int status = ordernm_switching(m, t, z);
    for (int i = 0; i < m->nheld && !status; ++i) {
        const int k = m->held[i];
        if (crossed && crossed[k] != 0.0) continue;
        if (ordernm_side(m, k) < 0.0) m->modes[k] = ordernm_other_mode(m, k);
        else status = leave_zero(m, t, z, k);
    }
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

/* How far switching functions are from zero at the beginning of a step, on the side of their modes. */
int ordernm_sides(ordernm_motion *m, scalar t, const scalar *z, scalar *sides)
{
    const int status = ordernm_switching(m, t, z);
    for (int i = 0; i < m->nheld; ++i) {
        const scalar side = ordernm_side(m, m->held[i]);
        sides[i] = side > LEAST_SIDE ? side : LEAST_SIDE;
    }
    return status;
}

/* The modes at the beginning. Where a switching function is zero there, it is asked where it goes to with either mode. Returns 0, what
 * a function returned, or SLIDES with the switch in the results. */
int ordernm_choose_modes(ordernm_motion *m, scalar t, const scalar *z)
{
    const scalar reach = AT_ZERO*(m->problem->end - m->problem->start);
    scalar *const rate = m->trial;
    int status;
    for (int k = 0; k < m->system->nswitches; ++k) m->modes[k] = 0.0, m->changed[k] = -INFINITY;
    if ((status = ordernm_switching(m, t, z))) return status;
    for (int i = 0; i < m->nheld; ++i) m->crossed[m->held[i]] = m->switches[m->held[i]];
    for (int i = 0; i < m->nheld; ++i) {
        const int k = m->held[i];
        const scalar g = m->crossed[k];
        if (m->system->switch_kind[k] > ORDERNM_ROOT) {
            m->switches[k] = g;
            m->modes[k] = mode_of(m, k);
            continue;
        }
        const int side = g > 0.0 ? 1 : -1; /* with the other branch of prescribed motion loops may not close */
        scalar way[3]; /* with the mode -1, 0, 1 */
        for (int n = 0; n < 3; ++n) {
            const int mode = n == 0 ? side : n == 1 ? 0 : -side;
            m->modes[k] = mode;
            if ((status = ordernm_rates_of(m, t, z, rate, 0, 0, RATES))) return status;
            if ((status = ordernm_switch_speed(m, t, z, rate, k, way + 1 + mode))) return status;
            if (n == 0 && fabs(g) > fmax(reach*fabs(way[1 + side]), way[1 + side] == 0.0 ? ROUNDED : 0.0)) break; /* it is not zero */
        }
        if (fabs(g) > fmax(reach*fabs(way[1 + side]), way[1 + side] == 0.0 ? ROUNDED : 0.0)) m->modes[k] = side;
        else if (way[2] >= 0.0 && way[0] >= 0.0 && way[2] + way[0] > 0.0) m->modes[k] = 1.0;
        else if (way[2] <= 0.0 && way[0] <= 0.0 && way[2] + way[0] < 0.0) m->modes[k] = -1.0;
        else if (way[1] == 0.0) m->modes[k] = 0.0; /* it rests there */
        else if (way[2] < 0.0) {
            m->results->component = k;
            return SLIDES;
        } else m->modes[k] = 1.0;
    }
    memset(m->crossed, 0, m->system->nswitches*sizeof(scalar));
    return 0;
}

/* A switching function comes to zero and turns, at the state in m->trial: derivatives do not exist where rates jump there. */
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

/* Rates that are held may have no value beyond a switch, such as a root of what is negative there. Such a step is made in whichever
 * branches its states are in, once smaller steps have not helped. Returns whether modes have been let go. */
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

/* What was let go for a step is held again. Returns what a function returned. */
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
        if (free || kind[k] == ORDERNM_TURN) m->modes[k] = mode_of(m, k); /* angles are those near where the step begins */
        m->switched |= free && m->modes[k] != 0.0;
        if (kind[k] <= ORDERNM_ROOT && m->let_go[k]*m->modes[k] < 0.0) m->results->not_held = k + 1;
        m->let_go[k] = 0.0;
    }
    return 0;
}

/* How long a step may be, by how fast angles turn that jump at half a turn. Returns what a function returned. */
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

/* At a knot of the inputs switching functions may jump; its time depends on nothing. */
int ordernm_follow_inputs(ordernm_motion *m)
{
    return ordernm_follow(m, m->t, m->z, 0);
}

/* ---- In rows of steps. ---- */

/* Modes as they are kept with a step, and whether the switch has just been crossed. */
void ordernm_keep_modes(const ordernm_motion *m, scalar *row)
{
    const int n = m->system->nswitches;
    for (int k = 0; k < n; ++k) row[k] = m->modes[k], row[n + k] = m->crossed[k] != 0.0;
}

/* Modes from such a row. */
void ordernm_take_modes(ordernm_motion *m, const scalar *row)
{
    const int n = m->system->nswitches;
    for (int k = 0; k < n; ++k) m->modes[k] = row[k], m->crossed[k] = row[n + k];
}
