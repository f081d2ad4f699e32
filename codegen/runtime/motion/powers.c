/* Steps near switches of kind ORDERNM_POWER and ORDERNM_ROOT, where rates are only as smooth as max(0, x)^1.5 and sqrt(max(0, x)).
 * Errors of the state do not show the errors of its derivatives, which decrease with a lower power of the step near the zero. With
 * derivatives, such steps are graded: they become shorter towards the zero, and longer after it. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* Largest distance, in lengths of the step, at which a zero of a switching function affects the step. */
static const scalar FARTHEST = 5.0;

/* Ratio of errors of derivatives to errors of the state, times T/h: h is the step size, T the time in which the state changes by its size.
 * The value holds for a zero within one step length. Farther away it decreases with the third power of the distance. */
static const scalar LARGER = 300.0;

/* Step size, relative to the time in which the state changes by its size. A shorter step is not repeated. A longer step must not end at the
 * zero: rounding may put the last stage beyond the zero, where derivatives of max(0, x)^1.1 are no longer small. */
static const scalar LEAST = 1e-9;

/* The step before may end after the zero of a root, because another switch has shortened it. If it ends after the zero by less than this
 * fraction of LEAST, the next step counts as a step that starts at the zero. */
static const scalar STILL_THERE = 0.25;

/* A step that ends at the zero with too large an error is repeated with TOWARDS times its size. A constant step has no error estimate: it
 * is always repeated with HALF its size, and after the zero no step is longer than EVEN times the distance to the zero. */
static const scalar TOWARDS = 0.8, HALF = 0.5, EVEN = 0.99;

/* Distance between an end of the step and the zero of the monitored function e, in step lengths; found from the rate of e at this end. */
static scalar distance(const ordernm_motion *m, int e, int last)
{
    const scalar at_end = last ? m->after[e] : m->crossing[e], inside = m->samples[(last ? EVENT_SAMPLES - 1 : 0)*m->nwatched + e];
    return inside > at_end ? at_end/(inside - at_end)*ordernm_event_point(1) : INFINITY;
}

/* Time in which the state changes by its size, in tolerances; at most the duration of the motion. */
static scalar time_of_change(const ordernm_motion *m)
{
    const ordernm_problem *const p = m->problem;
    scalar size = 0.0, rate = 0.0;
    for (int i = 0; i < m->ny + m->nx; ++i) {
        const scalar largest = fmax(fabs(m->z[i]), fabs(m->next[i])), unit = p->atol[i] + p->rtol*largest;
        size += largest/unit*(largest/unit);
        rate += m->rate[0][i]/unit*(m->rate[0][i]/unit);
    }
    return fmin(sqrt(size/rate), p->end - p->start);
}

/* Whether a switch is a power or a root. */
static int has_power(const ordernm_motion *m, int k)
{
    const int kind = m->system->switch_kind[k];
    return kind == ORDERNM_POWER || kind == ORDERNM_ROOT;
}

/* Functions have a common zero if they are proportional for all changes of state and parameters, within this relative tolerance. */
static const scalar IN_PROPORTION = 1e-9;

/* Whether the step starts at the zero of a root, switch k. */
static int begins_at_root(const ordernm_motion *m, int k)
{
    if (m->system->switch_kind[k] != ORDERNM_ROOT || !(m->changed[k] > -INFINITY)) return 0;
    return m->t - m->changed[k] <= STILL_THERE*LEAST*time_of_change(m);
}

/* Whether the step starts or ends at the zero of a root: switch k, with the monitored function e. */
static int is_at_root(const ordernm_motion *m, const trial *step, int k, int e)
{
    return begins_at_root(m, k) || (m->system->switch_kind[k] == ORDERNM_ROOT && step->event >= 0 && m->happened[e] > 0.0);
}

/* Whether all roots at whose zeros the step starts or ends have a common zero. */
static int have_one_zero(ordernm_motion *m, const trial *step)
{
    const ordernm_system *const s = m->system;
    scalar *const along_time = m->switches_kept, *const direction = m->trial;
    ordernm_call c;
    int first = -1;
    for (int n = 0; n < 2; ++n) {
        for (int i = 0; i < m->ny; ++i) direction[i] = n ? cos(1.0 + 7.0*i) : m->rate[0][i];
        if (ordernm_along_time(m, m->t, m->z, direction, &c)) return 0;
        if (n) c.dp = (scalar *)m->p, c.dt = m->dt;
        c.switches = m->switches, c.dswitches = m->dswitches;
        if (ORDERNM_OF(m, switch_sensitivities[ORDERNM_ONE])(&c)) return 0;
        if (!n) memcpy(along_time, m->dswitches, s->nswitches*sizeof(scalar));
    }
    for (int i = 0; i < m->nheld; ++i) {
        const int k = m->held[i];
        if (!is_at_root(m, step, k, m->problem->nevents + i)) continue;
        if (first < 0) first = k;
        const scalar one = m->dswitches[k]*along_time[first], other = m->dswitches[first]*along_time[k];
        if (!(fabs(one - other) <= IN_PROPORTION*(fabs(one) + fabs(other)))) return 0;
    }
    return 1;
}

/* The root at whose zero the motion begins, and whose function has a rate there; -1 if the rate is zero, or if another root has another
 * zero at the start. `some` receives the last root at whose zero the motion begins, else -1. Marks the root as passed at the start. */
static int root_at_start(ordernm_motion *m, int *some)
{
    const trial none = {.event = -1};
    int first = -1, rests = 0;
    *some = -1;
    for (int i = 0; i < m->nheld; ++i) {
        const int k = m->held[i], free = m->modes[k] == 0.0; /* without a mode: rests at the zero */
        scalar speed = 0.0;
        if (m->system->switch_kind[k] != ORDERNM_ROOT || !(free || ordernm_begins_at_zero(m, k, &speed))) continue;
        *some = k;
        rests |= speed == 0.0;
        if (first < 0) first = k;
        m->changed[k] = m->t;
    }
    return first >= 0 && !rests && have_one_zero(m, &none) ? first : -1;
}

/* If the motion begins at the zero of a root that has a rate, the first step treats the root as one that was just passed. Rates of
 * derivatives along directions that move this zero are infinite at the start, but not needed: they are set to zero. If the motion begins at
 * the zero of a root in another way, returns this root, since some derivatives may not exist; else -1. */
int ordernm_begin_at_root(ordernm_motion *m)
{
    int some;
    const int k = root_at_start(m, &some);
    if (k < 0 || ordernm_switch_along(m, m->t, m->z, k)) {
        for (int i = 0; i < m->system->nswitches; ++i) m->changed[i] = -INFINITY;
        return some;
    }
    for (int n = 0; n < m->ngroups; ++n) {
        const group *const g = m->groups + n;
        for (int l = 0; l < g->width; ++l)
            for (long i = 0; m->switch_along[n*LANES + l] != 0.0 && i < m->ny + m->nx; ++i) m->rate[0][g->at + i*g->width + l] = 0.0;
    }
    return -1;
}

/* The error of derivatives in a step near the zero of a power or root; else 0. `error` is the error of the state; the step may end at the
 * zero. Records a step as short as LEAST that starts or ends at the zero of a root. Sets m->advice for the step size. */
scalar ordernm_error_beside_powers(ordernm_motion *m, const trial *step, scalar error)
{
    const int events = m->problem->nevents;
    int ends = 0, begins = 0, roots = 0;
    scalar nearest = INFINITY, behind = INFINITY;
    for (int i = 0; i < m->nheld; ++i) {
        const int k = m->held[i];
        if (!has_power(m, k)) continue;
        const int happens = step->event >= 0 && m->happened[events + i] > 0.0, begun = begins_at_root(m, k);
        const int at_root = is_at_root(m, step, k, events + i);
        ends |= happens;
        begins |= begun;
        behind = fmin(behind, begun ? 0.0 : distance(m, events + i, 0));
        nearest = happens ? 0.0 : fmin(nearest, fmin(behind, distance(m, events + i, 1)));
        if (!at_root) continue;
        m->root = k;
        ++roots;
    }
    m->beside_power = nearest <= FARTHEST;
    if (!m->beside_power) return 0.0;
    const scalar time = time_of_change(m), larger = LARGER*error*time/step->h/pow(fmax(nearest, 1.0), 3.0);
    if (step->h > LEAST*time) {
        const scalar least = 0.5*LEAST*time/step->h;
        m->root = -1;
        if (!ends && !begins && m->adaptive) return larger;
        if (begins || behind < EVEN) m->advice = begins ? least : fmax(behind, least);
        else if (ends) m->advice = !m->adaptive ? HALF : larger > 1.0 ? TOWARDS : 1.0 - least;
        else return 0.0;
        return INFINITY;
    }
    if (roots > 1 && !have_one_zero(m, step)) m->root = MANY_ROOTS;
    if (roots) m->root_end = m->t + step->h;
    return 0.0;
}

/* Derivatives after a step that starts or ends at the zero of a root. Perturbed motions reach the zero at a time that differs by dt, and do
 * not differ otherwise: S+ = S + (f - f+) dt. Other changes of derivatives are negligible for such a short step. Returns the status of a
 * function. */
int ordernm_beside_root(ordernm_motion *m, const trial *step)
{
    scalar *const before = m->error[0], *const after = m->error[1], speed;
    int status = ordernm_rates_of(m, m->t + step->h, m->next, after, 0, 0, RATES | INTEGRALS);
    if (!status) status = ordernm_rates_of(m, m->t, m->z, before, 0, 0, RATES | INTEGRALS);
    if (!status) status = ordernm_switch_speed(m, m->t, m->z, before, m->root, &speed);
    if (!status) status = ordernm_switch_along(m, m->t, m->z, m->root);
    for (int n = 0; n < m->ngroups && !status; ++n) {
        const group *const g = m->groups + n;
        for (long i = 0; i < m->ny + m->nx; ++i)
            for (int l = 0; l < g->width; ++l) {
                const long at = g->at + i*g->width + l;
                m->next[at] = m->z[at] - (before[i] - after[i])*m->switch_along[n*LANES + l]/speed;
            }
    }
    return status ? status : ordernm_rates(m, m->t + step->h, m->next, m->rate[m->method->stages]);
}

/* ---- Where derivatives are not continued. ---- */

/* Rates change like a power of the distance from the zero. The exponent is found from three distances, relative to the step. */
static const scalar FAR = 1.0, NEARER = 0.1;

/* Exponents above POWER_OF_ONE count as 1; changes below NO_CHANGE, relative to the largest rate, count as zero. */
static const scalar POWER_OF_ONE = 0.95, NO_CHANGE = 1e-8;

/* Change of rates between one end of the step and a place in it, in tolerances. Returns the status of a function. */
static int changes(ordernm_motion *m, scalar h, int last, scalar away, scalar *rates)
{
    const ordernm_problem *const p = m->problem;
    const scalar part = last ? 1.0 - away : away, *const here = m->rate[last ? m->method->stages : 0];
    m->method->interpolate(m, h, part, m->trial);
    const int status = ordernm_rates_of(m, m->t + part*h, m->trial, rates, 0, 0, RATES | INTEGRALS);
    for (int i = 0; i < m->ny + m->nx; ++i) rates[i] = fabs(rates[i] - here[i])/(p->atol[i] + p->rtol*fabs(m->z[i]));
    return status;
}

/* Whether derivatives of rates are unbounded at one end of the step, as for sqrt(max(0, x)). */
static int grow(ordernm_motion *m, scalar h, int last)
{
    const ordernm_problem *const p = m->problem;
    const scalar *const here = m->rate[last ? m->method->stages : 0];
    scalar *const changed[] = {m->error[0], m->error[1], m->at_pose}, largest = 0.0, away = FAR;
    for (int n = 0; n < 3; ++n, away *= NEARER)
        if (changes(m, h, last, away, changed[n])) return 0;
    for (int i = 0; i < m->ny + m->nx; ++i) largest = fmax(largest, fabs(here[i])/(p->atol[i] + p->rtol*fabs(m->z[i])));
    const scalar less = pow(NEARER, POWER_OF_ONE);
    for (int i = 0; i < m->ny + m->nx; ++i)
        if (changed[0][i] > NO_CHANGE*largest && changed[1][i] > less*changed[0][i] && changed[2][i] > less*changed[1][i]) return 1;
    return 0;
}

/* A switch at whose zero a step starts or ends, if derivatives of rates are unbounded there; -1 if there is none. Such a step is constant,
 * or passes other switches too. */
int ordernm_growing_power(ordernm_motion *m, const trial *step)
{
    for (int i = 0; i < m->nheld && (!m->adaptive || m->root == MANY_ROOTS); ++i) {
        const int k = m->held[i], ends = step->event >= 0 && m->happened[m->problem->nevents + i] > 0.0;
        if (!has_power(m, k)) continue;
        if (ends && grow(m, step->h, 1)) return k;
        if (m->changed[k] == m->t && grow(m, step->h, 0)) return k;
    }
    return -1;
}
