/* Passing switches: a step has ended where switching functions are zero; modes change, and derivatives along directions jump.
 *
 * The state is continuous there, and
 *
 *     S+ = S- + (f- - f+) dt,  dt = -(g_z S- + g_p)/g',  g' = g_z f- + g_t,
 *
 * with the rates f- and f+ before and after. Simultaneous switches are passed in this way one after another. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* Rate of a switching function at its zero, relative to its range in the step over the step size, below which it only touches zero. */
static const scalar GRAZING = 1e-9;

/* Fractions of the motion's duration: switches accumulate if they are passed within the first fraction; if a switch is passed twice within
 * the second fraction, the cause is rounding. */
static const scalar ACCUMULATED = 1e-8, AT_ONCE = 1e-12;

/* Counts switches with a jump that are passed repeatedly in a time that is negligible for the motion. Switches with kinks are not counted,
 * because kinks alone do not accumulate; frequent kinks have another cause, such as unbounded speeds. */
static void count(ordernm_motion *m, int k)
{
    if (m->passed == 0 || m->t - m->accumulating > ACCUMULATED*(m->problem->end - m->problem->start)) {
        m->accumulating = m->t;
        m->passed = 0;
    }
    ++m->passed;
    m->last_passed = k;
}

/* Changes the mode of a switch whose function is zero at a state z. `before` are the rates before the switch; `after`, and derivatives
 * along directions in z, receive the values after the switch. *left is the number of switches in m->crossed that are passed later; if *left
 * is 0, all other switches take the modes of their functions. If `left` is a null pointer, other switches keep their modes. Returns the
 * status of a function. */
static int pass(ordernm_motion *m, scalar *z, int k, const scalar *before, scalar *after, int *left, scalar *speed)
{
    const long n = m->ny + m->nx;
    int by, status = ordernm_timing_switch(m, m->t, z, before, m->crossed, k, speed, &by);
    if (!status && m->ngroups) status = ordernm_switch_along(m, m->t, z, by);
    if (status) return status;
    if (left) memcpy(m->switches_kept, m->switches, m->system->nswitches*sizeof(scalar));
    m->modes[k] = by == k ? ordernm_other_mode(m, k) : 0.0;
    if (left && (*left || m->ntogether > 1) && by == k && (status = ordernm_remove_jumped(m, k, m->switches_kept, left))) return status;
    if (left && !*left && (status = ordernm_follow(m, m->t, m->z, m->crossed))) return status;
    if ((status = ordernm_rates_of(m, m->t, z, after, 0, 0, RATES | INTEGRALS))) return status;
    for (int i = 0; i < m->ngroups*LANES; ++i) m->passing_time[i] = -m->switch_along[i]/ *speed;
    if (!ordernm_rates_jump(m, before, after) || !(fabs(*speed) > GRAZING*m->crossed[k])) return 0;
    for (int g = 0; g < m->ngroups; ++g) {
        const group *const of = m->groups + g;
        scalar *const S = z + of->at;
        for (int i = 0; i < n; ++i)
            for (int l = 0; l < of->width; ++l)
                S[i*of->width + l] += (before[i] - after[i])*m->passing_time[g*LANES + l];
    }
    return 0;
}

/* Whether derivatives are needed, forward or by the adjoint. */
static int is_differentiated(const ordernm_motion *m) { return m->ngroups || m->results->steps; }

/* Whether a switch counts as passed at the same time as the switches passed last: within AT_THE_SAME_TIME, or because errors of the state
 * may reverse the order. `before` are the rates before the switch. */
static int joins(ordernm_motion *m, int k, const scalar *before)
{
    scalar speed;
    if (!m->ntogether) return 0;
    for (int i = 0; i < m->ntogether; ++i)
        if (m->together[i] == k) return 0;
    if (m->t - m->together_since <= AT_THE_SAME_TIME*(m->problem->end - m->problem->start)) return 1;
    if (!is_differentiated(m) || ordernm_find_switch_errors(m, m->t, m->z)) return 0;
    if (ordernm_switch_speed(m, m->t, m->z, before, k, &speed)) return 0;
    for (int i = 0; i < m->ntogether; ++i)
        if (ordernm_may_precede(m, m->t - m->changed[m->together[i]], m->switch_errors + 2*k, speed, m->together[i])) return 1;
    return 0;
}

/* Adds a switch to the list of switches passed at the same time, or starts a new list. */
static void gather(ordernm_motion *m, int k, const scalar *before)
{
    if (!joins(m, k, before)) {
        m->ntogether = m->together_jump = 0;
        m->together_since = m->t;
        memcpy(m->z_before, m->z, m->size*sizeof(scalar));
        memcpy(m->modes_before, m->modes, m->system->nswitches*sizeof(scalar));
    }
    m->together[m->ntogether++] = k;
}

/* Whether derivatives along a direction differ between two orders of switches, relative to the jumps of these derivatives. */
static int differ(const ordernm_motion *m, const group *of, int lane, const scalar *one, const scalar *other)
{
    for (long i = 0; i < m->ny + m->nx; ++i) {
        const long at = of->at + i*of->width + lane;
        const scalar here = one[at], there = other[at], first = m->z_before[at];
        const scalar allowed = ORDER_MATTERS*(fabs(here - first) + fabs(there - first)) + 1e-10*(fabs(here) + fabs(first));
        if (!(fabs(here - there) <= allowed)) return 1;
    }
    return 0;
}

/* Passes the switches at the current state in the given order, with the derivatives before the first switch. Orders 0 to n - 1 are the
 * rotations of the n switches; the next n are the rotations in reverse. Returns the status of a function. */
static int pass_in_order(ordernm_motion *m, int order, scalar *z, scalar *rates)
{
    const int n = m->ntogether;
    scalar speed;
    memcpy(z, m->z, m->values*sizeof(scalar));
    memcpy(z + m->values, m->z_before + m->values, (m->size - m->values)*sizeof(scalar));
    for (int i = 0; i < n; ++i) m->modes[m->together[i]] = m->modes_before[m->together[i]];
    int status = ordernm_rates_of(m, m->t, z, rates, 0, 0, RATES | INTEGRALS);
    for (int i = 0; i < n && !status; ++i) {
        const int at = (order < n ? i : n - 1 - i) + order;
        memcpy(m->trial, rates, m->values*sizeof(scalar));
        status = pass(m, z, m->together[at%n], m->trial, rates, 0, &speed);
    }
    return status;
}

/* Several switches are passed at the same time. A perturbed motion passes them one after another, in an order that depends on the
 * perturbation. There is no derivative along a direction for which the order matters. All orders of up to three switches are compared; of
 * more switches, the rotations of two orders. Returns the status of a function. */
static int compare_orders(ordernm_motion *m)
{
    const int n = m->ntogether, count = m->system->nswitches;
    scalar *const first = m->z_after, *const z = m->error[0], *const rates = m->rate[1];
    scalar *const kept = m->switches_kept;
    memcpy(kept, m->modes, count*sizeof(scalar));
    int status = pass_in_order(m, 0, first, rates);
    for (int order = 1; order < 2*n && !status; ++order) {
        status = pass_in_order(m, order, z, rates);
        for (int g = 0; g < m->ngroups && !status; ++g)
            for (int l = 0; l < m->groups[g].used; ++l)
                if (differ(m, m->groups + g, l, first, z)) m->lost[g*LANES + l] = m->switch_time[g*LANES + l] = NAN, m->results->ordered = 1;
    }
    memcpy(m->modes, kept, count*sizeof(scalar));
    return status;
}

/* Whether an output with an event depends on a switch. */
static int times_event(const ordernm_motion *m, int k)
{
    const ordernm_system *const s = m->system;
    const ordernm_problem *const p = m->problem;
    for (int i = 0; i < s->nswitch_outputs; ++i)
        for (int e = 0; s->switch_of_output[2*i] == k && e < p->nevents; ++e)
            if (p->events[e].output == s->switch_of_output[2*i + 1]) return 1;
    return 0;
}

/* Stores derivatives of the time of a switch, for events of outputs that jump there; NaN if two such switches differ. */
static void note_time(ordernm_motion *m, int k, int *timed)
{
    if (!times_event(m, k)) return;
    for (int i = 0; i < m->ngroups*LANES; ++i) {
        const scalar here = m->lost[i] + m->passing_time[i], first = m->switch_time[i];
        m->switch_time[i] = !*timed || fabs(here - first) <= ORDER_MATTERS*(fabs(here) + fabs(first)) ? here : NAN;
    }
    *timed = 1;
}

/* Whether a switch that was passed with the given rate of its function is only touched. This is the case if the rate changes its sign
 * within the time by which an error of the state moves the zero. The rate is that of the branch before the switch, with rates `before`. */
static int grazes(ordernm_motion *m, int k, scalar speed, const scalar *before)
{
    const scalar mode = m->modes[k];
    scalar *const z = m->error[0], *const rates = m->rate[1];
    if (!(fabs(speed) > GRAZING*m->crossed[k])) return 1;
    if (ordernm_find_switch_errors(m, m->t, m->z)) return 0;
    const scalar time = ordernm_switch_error(m, k)/fabs(speed);
    int turns = 0;
    m->modes[k] = m->modes_before[k];
    for (int after = 0; after < 2 && time > 0.0 && !turns; ++after) {
        const scalar by = after ? time : -time;
        scalar there;
        memcpy(z, m->z, m->values*sizeof(scalar));
        for (int i = 0; i < m->ny + m->nx; ++i) z[i] += by*before[i];
        if (ordernm_rates_of(m, m->t + by, z, rates, 0, 0, RATES) || ordernm_switch_speed(m, m->t + by, z, rates, k, &there)) continue;
        turns = there*speed < 0.0;
    }
    m->modes[k] = mode;
    return turns;
}

/* Whether the rates after all passed switches drive the motion back to one of these switches. */
static int slides(ordernm_motion *m, const scalar *after)
{
    for (int k = 0; k < m->system->nswitches; ++k) {
        scalar way;
        if (m->speeds[k] == 0.0) continue;
        const int status = ordernm_switch_speed(m, m->t, m->z, after, k, &way);
        if (status) return status;
        if (m->speeds[k]*way > 0.0) continue;
        m->results->component = k;
        return SLIDES;
    }
    return 0;
}

/* Passes the switches in m->crossed, whose functions are zero at the end of a step, where rate[0] are the rates before these switches.
 * Updates modes, rates and derivatives along directions. Returns 0, the status of a function, or SLIDES. */
int ordernm_pass_switches(ordernm_motion *m)
{
    const ordernm_system *const s = m->system;
    scalar *const before = m->trial, *const after = m->rate[0];
    int left = 0, status, timed = 0;
    for (int k = 0; k < s->nswitches; ++k) left += m->crossed[k] != 0.0;
    memset(m->speeds, 0, s->nswitches*sizeof(scalar));
    for (int k = 0; k < s->nswitches; ++k) {
        if (m->crossed[k] == 0.0) continue;
        scalar speed;
        const int at_once = m->t - m->changed[k] <= AT_ONCE*(m->problem->end - m->problem->start);
        if (s->drives[k] > 1) m->results->moved = k + 1, m->results->moved_at = m->t;
        memcpy(before, m->rate[0], (m->ny + m->nx)*sizeof(scalar));
        gather(m, k, before);
        m->changed[k] = m->t;
        --left;
        if ((status = pass(m, m->z, k, before, after, &left, &speed))) return status;
        m->passing_speed[k] = speed;
        note_time(m, k, &timed);
        if (m->modes[k] == 0.0) --m->ntogether; /* another switch determines the time of this one */
        if (!ordernm_rates_jump(m, before, after)) {
            if (at_once) m->modes[k] = 0.0; /* rounding crosses a kink repeatedly */
            continue;
        }
        count(m, k);
        if (m->modes[k] != 0.0) m->speeds[k] = speed != 0.0 ? speed : LEAST_SIDE;
        m->together_jump = 1;
        if (is_differentiated(m) && grazes(m, k, speed, before)) m->results->grazed = k + 1;
    }
    if ((status = slides(m, after))) return status;
    memcpy(m->z_after, m->z, m->size*sizeof(scalar));
    if (m->ntogether < 2 || !(m->together_jump || timed)) return 0;
    if (!m->results->ordered) { /* the switches at which the first derivatives are lost */
        m->results->together = 1 + m->together[m->ntogether - 1];
        m->results->together_with = 1 + m->together[m->ntogether - 2];
        m->results->together_at = m->t;
    }
    return m->ngroups ? compare_orders(m) : 0;
}

/* Whether switches are passed faster and faster. */
int ordernm_accumulates(const ordernm_motion *m)
{
    if (m->passed < 3 || m->t - m->accumulating > ACCUMULATED*(m->problem->end - m->problem->start)) return 0;
    m->results->component = m->last_passed;
    return 1;
}
