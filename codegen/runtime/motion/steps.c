/* The transition from one step to the next, in a motion and when steps are repeated. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* Limits of condition numbers if derivatives are needed, forward or by the adjoint. Near a pose where a loop loses rank, rounding errors of
 * derivatives are multiplied by condition number^3, times a factor of ten to a hundred; but forward derivatives and the adjoint must agree
 * to rounding. A condition number that is always large follows from the mechanism's proportions and is harmless. So the limit is WORSE (for
 * the method of order 8, WORSE_IN_LONG_STEPS) times the smallest condition number so far, and at most POOR_IN_ANY_CASE.
 * TOO_POOR_FOR_DERIVATIVES limits all stages. */
static const scalar WORSE_IN_LONG_STEPS = 2.5, WORSE = 6.0, POOR_IN_ANY_CASE = 30.0, TOO_POOR_FOR_DERIVATIVES = 50.0;

/* Sets limits for derivatives, forward or by the adjoint; `best` is the smallest condition number at the start of a step so far. */
void ordernm_take_derivatives(ordernm_motion *m, scalar best)
{
    const scalar worse = m->method == &ordernm_dop853 ? WORSE_IN_LONG_STEPS : WORSE;
    m->best = best;
    m->derived = 1;
    if (ordernm_may_be_steep(m) && !m->flowing) ordernm_follow_flow(m);
    m->poor_rates = fmin(m->poor, fmin(worse*best, POOR_IN_ANY_CASE));
    m->too_poor = fmin(m->too_poor, TOO_POOR_FOR_DERIVATIVES);
}

/* Updates the smallest condition number at the start of a step. */
void ordernm_note_best(ordernm_motion *m)
{
    const scalar best = fmin(m->best, m->conditions[0]);
    if (m->derived && best < m->best) ordernm_take_derivatives(m, best);
}

/* The end of a step becomes the start of the next one; `knot` is the first knot of the inputs after the start of the completed step.
 * `settled`: the state was interpolated at a pose, and is already consistent. Repetitions of steps, which pass their stored `modes`, use
 * this function, too, so that rounding errors are the same. */
int ordernm_next_step(ordernm_motion *m, scalar end, scalar knot, int settled, const scalar *modes)
{
    int status;
    m->t = end;
    ordernm_exchange(&m->z, &m->next);
    ordernm_exchange(&m->rate[0], &m->rate[m->method->stages]);
    m->precise = m->precise_at_end;
    ordernm_note_precise(m, 0);
    const int changed = settled ? 0 : ordernm_settle(m, m->t, m->z);
    if (changed < 0) return changed;
    ordernm_note_condition(m, 0, 0);
    ordernm_note_best(m);
    const int at_knot = ordernm_next_knot(m, m->t) != knot;
    m->switched = 0;
    if (modes) {
        ordernm_take_modes(m, modes);
        for (int k = 0; k < m->system->nswitches; ++k) m->switched |= m->crossed[k] != 0.0;
    } else if (m->nheld) {
        for (int k = 0; k < m->system->nswitches; ++k) m->switched |= m->crossed[k] != 0.0;
        if (m->switched && (status = ordernm_pass_switches(m))) return status;
        if ((status = ordernm_hold_again(m))) return status;
    }
    if (!changed && !at_knot && !m->switched) return m->flow_unknown ? ordernm_begin_flow(m) : 0;
    if (m->nheld && at_knot && !modes && (status = ordernm_arrive_at_knot(m))) return status;
    if (at_knot && (status = ordernm_reach_knot(m))) return status;
    const long before = m->segment;
    ordernm_find_next_segment(m);
    if (m->nheld && at_knot && !modes && (status = ordernm_follow_inputs(m))) return status;
    if (m->nheld && at_knot && !modes) ordernm_look_beside_knot(m, before);
    status = ordernm_rates(m, m->t, m->z, m->rate[0]);
    if (!status && m->flowing) status = ordernm_begin_flow(m);
    ordernm_note_precise(m, 0);
    return status;
}
