/* Derivatives along the motion itself, whose exact values are known: if the start is shifted by dt, so is the whole motion. The derivative
 * of each state with respect to this shift is the rate there. So the step's derivative along its first rate minus the rate at its end is an
 * error of derivatives. In a steep layer, such as tanh(u/1e-4) where u changes its sign, this error exceeds that of the state by the width
 * of the layer, and limits the step. Only for systems with functions that may be steep; the points of cubic tables count as such. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* Largest allowed error of a step's derivatives along the motion, relative to the rates. The unit is the relative error of the state that
 * the tolerances allow. */
static const scalar ALLOWED = 10.0;

/* Errors relative to the rates that rounding may cause: below ROUNDED in any case; below NOISE if a shorter step has no smaller error. */
static const scalar ROUNDED = 1e-12, NOISE = 1e-9;

/* Let r < SHORTER be the ratio of a step's size to that of the longer step with the largest error, both from the same start. Rates count as
 * jumping, and derivatives as undefined, if the error still exceeds sqrt(r) times the largest one, although the error of the state is below
 * SMALLEST relative to the state. At a kink, errors decrease in proportion to the step, but not evenly: they depend on the place of the
 * kink in the step. In a steep layer, any error may be small by chance. Steps below SHORTEST, relative to the motion, are not shortened any
 * more. */
static const scalar SHORTER = 1e-3, SMALLEST = 1e-12, SHORTEST = 1e-12;

/* Two limits of a loop's condition number: an absolute one, and one relative to the smallest number so far. Above both, the loop is near a
 * loss of rank, and rounding errors dominate. */
static const scalar POOR = 30.0, WORSE = 6.0;

/* Adds derivatives along the motion to the state, behind all others. */
void ordernm_follow_flow(ordernm_motion *m)
{
    m->flowing = 1;
    m->size += ordernm_whole_lines(m->ny + m->nx);
}

/* Sets the derivatives of the state to the rates. */
void ordernm_set_flow(ordernm_motion *m)
{
    m->flow_unknown = 0;
    memcpy(m->z + m->groups[m->ngroups].at, m->rate[0], (m->ny + m->nx)*sizeof(scalar));
}

/* Begins derivatives along the motion at the state; computes the rates there unless the method has left them. Returns the status of a
 * function. */
int ordernm_begin_flow(ordernm_motion *m)
{
    ordernm_set_flow(m);
    return m->method->gives_rate ? 0 : ordernm_rates(m, m->t, m->z, m->rate[0]);
}

/* The error of derivatives along the motion in a step, relative to the tolerance; `of_state` is the error of the state, and `rate` contains
 * the rates at the end. Errors that only rounding or a jump of rates explains are zero. */
scalar ordernm_error_along_flow(ordernm_motion *m, scalar h, scalar of_state, const scalar *rate)
{
    const ordernm_problem *const p = m->problem;
    const scalar *const found = m->next + m->groups[m->ngroups].at;
    const int n = m->ny + m->nx;
    scalar size = 0.0, rates = 0.0, errors = 0.0;
    if (m->flow_unknown) return 0.0;
    m->flow_unknown = m->beside_power || (m->nd && m->results->condition_here > fmax(POOR, WORSE*m->best));
    if (m->flow_unknown) return 0.0;
    for (int i = 0; i < n; ++i) {
        const scalar largest = fmax(fabs(m->z[i]), fabs(m->next[i])), scale = p->atol[i] + p->rtol*largest;
        const scalar of_size = largest/scale, of_rate = fmax(fabs(rate[i]), fabs(m->rate[0][i]))/scale;
        const scalar error = (found[i] - rate[i])/scale;
        size += of_size*of_size;
        rates += of_rate*of_rate;
        errors += error*error;
    }
    m->flow_unknown = !(errors < INFINITY);
    const scalar error = errors > 0.0 ? sqrt(errors/rates) : 0.0, unit = sqrt(n/size);
    const int again = m->t == m->flow_at && h < m->flow_step, rounded = error < NOISE && error > m->flow_error*h/m->flow_step;
    if (!again || error >= m->flow_most) m->flow_most = error, m->flow_most_step = h;
    const int remains = h < SHORTER*m->flow_most_step && error > m->flow_most*sqrt(h/m->flow_most_step);
    const int jumps = (remains && of_state*unit < SMALLEST) || h < SHORTEST*fmax(fabs(m->t), p->end - p->start);
    m->flow_error = error, m->flow_step = h, m->flow_at = m->t;
    return again && (rounded || jumps) ? 0.0 : error/(ALLOWED*fmax(unit, ROUNDED/ALLOWED));
}
