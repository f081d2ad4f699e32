/* Step sizes: the first one, the next one by the error of the last, and the points at which steps must end. */
#include "inside.h"

#include <math.h>
#include <string.h>

static const scalar SAFETY = 0.9, LEAST_CHANGE = 0.333, LARGEST_CHANGE = 6.0, AFTER_FAILURE = 0.25;

/* Influence of the previous step's error on the step size (K. Gustafsson; Hairer, Wanner, Solving ODE II, IV.2). MEMORY and SAFETY reduce
 * the number of rejected steps to a third, and the evaluations for a given error by 7 %. */
static const scalar MEMORY = 0.04, LEAST_REMEMBERED = 1e-4;

/* For DOP853: the stability limit; the number of steps at the limit that counts as stiff; and the number of other steps that resets the
 * count. */
static const scalar LIMIT_OF_STABILITY = 6.1;
enum { FAR_STEPS = 15, NEAR_STEPS = 6 };

/* With derivatives, steps are limited to this fraction of the stability limit. Beyond it, errors of a fast component grow from step to
 * step. These errors start as rounding errors. Before they are visible in the state, they have grown by many orders of magnitude in
 * derivatives. */
static const scalar STABLE = 4.5;

/* The differences of rates and states at two stages give the largest eigenvalue only where the differences exceed rounding. After a step
 * near the limit, the eigenvalue is computed separately in this number of steps. */
enum { FAST_STEPS = 50 };
static const scalar NEARLY_STABLE = 2.0;

/* Error assigned to a step that must be rejected because rates differ between the last two stages, which are both at the step's end. */
static const scalar JUMPS = 1e3;

/* The first step size (E. Hairer, S. P. Norsett, G. Wanner, section II.4). Returns the status of a function. */
int ordernm_first_step(ordernm_motion *m, scalar limit, scalar *h)
{
    const ordernm_problem *const p = m->problem;
    const int n = ordernm_counted(m);
    scalar size = 0.0, rate = 0.0, bend = 0.0;
    *h = limit;
    if (!n) return 0;
    for (int i = 0; i < n; ++i) {
        const scalar scale = p->atol[i] + p->rtol*fabs(m->z[i]);
        size += m->z[i]/scale*(m->z[i]/scale);
        rate += m->rate[0][i]/scale*(m->rate[0][i]/scale);
    }
    size = sqrt(size/n);
    rate = sqrt(rate/n);
    scalar first = size < 1e-5 || rate < 1e-5 ? 1e-6 : 0.01*size/rate;
    if (first > limit) first = limit;
    static const int which[] = {0};
    static const scalar one[] = {1.0};
    ordernm_combine(m->size, m->trial, m->z, first, 1, which, one, m->rate);
    const int status = ordernm_rates(m, m->t + first, m->trial, m->rate[1]);
    if (status) return status;
    for (int i = 0; i < n; ++i) {
        const scalar scale = p->atol[i] + p->rtol*fabs(m->z[i]);
        const scalar of = (m->rate[1][i] - m->rate[0][i])/scale;
        bend += of*of;
    }
    bend = sqrt(bend/n)/first;
    const scalar steepest = bend > rate ? bend : rate;
    const scalar second = steepest <= 1e-15 ? (first*1e-3 > 1e-6 ? first*1e-3 : 1e-6)
                                            : pow(0.01/steepest, 1.0/m->method->order);
    *h = 100.0*first < second ? 100.0*first : second;
    return 0;
}

/* ---- Stability. ---- */

/* The largest eigenvalue of the rates' Jacobian at the end of a step, by one power iteration, scaled with the tolerances. Rates of
 * coordinates are speeds, so the vector grows and shrinks alternately: the growth is the mean of this step and of the one before. */
static scalar fastest(ordernm_motion *m, scalar end)
{
    ordernm_results *const r = m->results;
    const ordernm_problem *const p = m->problem;
    const scalar condition = r->condition, here = r->condition_here, *const rate = m->rate[m->method->stages];
    scalar *const beside = m->error[0], *const moved = m->error[1], size = 0.0, growth = 0.0;
    for (int i = 0; i < m->ny; ++i) size += m->fast[i]*m->fast[i];
    for (int i = 0; i < m->ny && size == 0.0; ++i) m->fast[i] = cos(1.0 + 7.0*i)/sqrt(m->ny);
    memcpy(beside, m->next, m->values*sizeof(scalar));
    for (int i = 0; i < m->ny; ++i) beside[i] += (p->atol[i] + p->rtol*fabs(m->next[i]))*m->fast[i];
    const int status = ordernm_rates_of(m, end, beside, moved, 0, 0, RATES);
    r->condition = condition, r->condition_here = here;
    if (status) return 0.0;
    for (int i = 0; i < m->ny; ++i) {
        m->fast[i] = (moved[i] - rate[i])/(p->atol[i] + p->rtol*fabs(m->next[i]));
        growth += m->fast[i]*m->fast[i];
    }
    growth = growth < INFINITY ? sqrt(growth) : 0.0;
    for (int i = 0; i < m->ny; ++i) m->fast[i] = growth > 0.0 ? m->fast[i]/growth : 0.0;
    const scalar mean = sqrt(growth*m->growth);
    m->growth = growth;
    return mean;
}

/* Whether stability limits the steps of an explicit method (E. Hairer, S. P. Norsett and G. Wanner, DOP853): the differences between its
 * last two stages, both at the end of the step, give the largest eigenvalue. */
void ordernm_watch_stability(ordernm_motion *m, const trial *step)
{
    const scalar *const last = m->rate[m->method->stages - 1], *const end = m->rate[m->method->stages];
    scalar rates = 0.0, states = 0.0;
    for (int i = 0; i < m->ny; ++i) {
        const scalar rate = end[i] - last[i], state = m->next[i] - m->trial[i];
        rates += rate*rate;
        states += state*state;
    }
    scalar product = states > 0.0 ? step->h*sqrt(rates/states) : 0.0;
    m->jumps_at_end = product > JUMPS;
    if (m->derived && product > NEARLY_STABLE && !m->jumps_at_end) m->fast_steps = FAST_STEPS;
    if (m->fast_steps > 0) {
        --m->fast_steps;
        product = step->h*fastest(m, step->end);
        if (product > NEARLY_STABLE) m->fast_steps = FAST_STEPS;
    }
    m->stable = m->derived && product > 0.0 && !m->jumps_at_end ? STABLE/product : INFINITY;
    if (product > (m->derived ? 0.9*STABLE : LIMIT_OF_STABILITY)) {
        m->near_steps = 0;
        if (++m->far_steps >= FAR_STEPS && product > m->results->stiffness) m->results->stiffness = product;
    } else if (++m->near_steps >= NEAR_STEPS) {
        m->far_steps = 0;
    }
}

/* Plans the end of a step: not beyond the end of the motion or a knot of the inputs, and without a tiny remainder. */
int ordernm_plan(ordernm_motion *m, trial *step)
{
    const ordernm_problem *const p = m->problem;
    step->knot = ordernm_next_knot(m, m->t);
    step->wall = step->knot < p->end ? step->knot : p->end;
    step->h = p->largest_step > 0.0 && m->h > p->largest_step ? p->largest_step : m->h;
    if (m->shorter > 0.0 && step->h > m->shorter) step->h = m->shorter;
    if (m->turning > 0.0 && step->h > m->turning) step->h = m->turning;
    const scalar left = step->wall - m->t, wanted = step->h;
    if (m->nd && m->method->gap > 0.0) step->h = ordernm_step_at_pose(m, step->h, step->wall);
    step->to_pose = step->h != wanted;
    step->again = 0;
    /* constant steps reach the end up to rounding */
    step->to_wall = step->h >= left*(1.0 - 1e-9) || left - step->h <= 1e-15*fabs(step->wall);
    if (step->to_wall) step->h = left;
    else if (m->adaptive && !step->to_pose && 2.0*step->h > left) step->h = 0.5*left;
    step->end = step->to_wall ? step->wall : m->t + step->h;
    step->event = -1;
    step->at_pose = 0;
    step->dead = 0.0;
    step->apart = 0;
    step->error = 0.0;
    if (step->h <= 4e-16*fabs(m->t) || !(step->h > 0.0)) return ORDERNM_COLLAPSED;
    ordernm_find_segment(m, m->t, step->h);
    return ORDERNM_ENDED;
}

/* Factor on the size of a step whose error is too large, or that failed (NAN). */
scalar ordernm_after_failure(const ordernm_motion *m, scalar error)
{
    return error == error ? fmax(LEAST_CHANGE, SAFETY*pow(error, -1.0/m->method->order)) : AFTER_FAILURE;
}

/* Sets the size of the next step. */
void ordernm_resize(ordernm_motion *m, const trial *step)
{
    const scalar before = m->error_before > 0.0 ? m->error_before : LEAST_REMEMBERED;
    scalar change = LARGEST_CHANGE;
    if (step->error > 0.0) change = SAFETY*pow(step->error, 0.75*MEMORY - 1.0/m->method->order)*pow(before, MEMORY);
    m->error_before = fmax(step->error, LEAST_REMEMBERED);
    change = m->advice > 0.0 ? m->advice : fmax(change, LEAST_CHANGE);
    change = fmin(fmin(change, m->stable), m->rejected_before ? 1.0 : LARGEST_CHANGE);
    m->rejected_before = 0;
    const int shorter = step->to_wall || step->to_pose;
    if (m->adaptive && step->event < 0 && !(shorter && change*step->h < m->h)) m->h = step->h*change;
}
