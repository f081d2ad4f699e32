/* Steps beside switches of kind ORDERNM_POWER, where rates are as smooth as max(0, x)^1.5. Errors of the state hardly show there how large
 * errors of its derivatives are: beside the zero these fall with a lower power of the step. With derivatives such steps are graded: they
 * become shorter and shorter towards the zero, and longer behind it. */
#include "inside.h"

#include <math.h>

/* A zero is beside a step as many of its lengths away. */
static const scalar BESIDE_STEP = 1.0;

/* Errors of derivatives over those of the state, in the time in which the state changes by its size over the step's. */
static const scalar LARGER = 1000.0;

/* Shorter steps, in parts of that time, are not made again. No longer one ends at the zero: rounding may put its last stage beyond, where
 * derivatives of max(0, x)^1.1 are no longer small. */
static const scalar LEAST = 1e-9;

/* Steps that end at the zero and whose errors are too large are made again over this part. */
static const scalar TOWARDS = 0.8;

/* Whether the zero of a switch that is watched as number e is in the step or beside it. */
static int is_beside(const ordernm_motion *m, int e)
{
    const scalar first = ordernm_event_point(1);
    const scalar at_start = m->crossing[e], near_start = m->samples[e];
    const scalar at_end = m->after[e], near_end = m->samples[(EVENT_SAMPLES - 1)*m->nwatched + e];
    return at_start - (near_start - at_start)/first*BESIDE_STEP <= 0.0 || at_end + (at_end - near_end)/first*BESIDE_STEP <= 0.0;
}

/* How long the state takes to change by its size, in units of what is allowed; at most all the motion. */
static scalar time_of_change(const ordernm_motion *m)
{
    const ordernm_problem *const p = m->problem;
    scalar size = 0.0, rate = 0.0;
    for (int i = 0; i < m->ny + m->nx; ++i) {
        const scalar unit = p->atol[i] + p->rtol*fabs(m->z[i]);
        size += m->z[i]/unit*(m->z[i]/unit);
        rate += m->rate[0][i]/unit*(m->rate[0][i]/unit);
    }
    return fmin(sqrt(size/rate), p->end - p->start);
}

/* The error of derivatives in a step beside such a zero; else 0. `error` is that of the step's state; the step may end at the zero. */
scalar ordernm_error_beside_powers(ordernm_motion *m, const trial *step, scalar error)
{
    const int events = m->problem->nevents;
    int beside = 0, ends = 0;
    for (int i = 0; i < m->nheld; ++i) {
        if (m->system->switch_kind[m->held[i]] != ORDERNM_POWER) continue;
        const int happens = step->event >= 0 && m->happened[events + i] > 0.0;
        ends |= happens;
        beside |= happens || is_beside(m, events + i);
    }
    const scalar time = beside ? time_of_change(m) : 0.0;
    if (!(step->h > LEAST*time)) return 0.0;
    const scalar larger = LARGER*error*time/step->h;
    if (!ends) return larger;
    m->advice = larger > 1.0 ? TOWARDS : 1.0 - 0.5*LEAST*time/step->h;
    return INFINITY;
}
