/* Events: outputs that cross a level within a step, the times of crossing, and steps that end there. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* Distance from the level, on the new side, assigned to an output that has just crossed the level, because rounding may have left it on the
 * old side. */
static const scalar BEHIND = 1e-300;

/* Two crossings of a level within a step are not visible at the step's ends. So outputs are also evaluated between the ends, and at extrema
 * that may lie beyond the level. */
enum { PARTS = EVENT_SAMPLES + 1, NEARER = 24, MOST_PLACES = PARTS + 1 + EVENT_SAMPLES };
static const scalar SAME_PLACE = 1e-7; /* relative to the step */

/* Extrema relative to the range of the switching function in the step: those below TOUCHING touch zero; those below NEAR are compared with
 * the errors of the function. */
static const scalar TOUCHING = 1e-12, NEAR = 0.1;

/* If rates at an event are undefined, the step ends at one of these positions after the event, relative to the step. */
enum { PLACES_BEHIND = 3 };
static const scalar JUST_BEHIND[PLACES_BEHIND] = {1e-13, 1e-12, 1e-11};

/* Distance by which a step continues beyond an event at a pose where a loop loses rank, relative to the step. */
static const scalar CUT_BEHIND = 0.1;

/* Outputs at a state minus the levels of events. Returns the status of a function. */
int ordernm_crossings(ordernm_motion *m, scalar t, const scalar *z, scalar *g)
{
    const ordernm_problem *const p = m->problem;
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    int status = ordernm_close_loops(m, &c);
    if (status) ordernm_arguments(m, t, z, &c); /* a loop has lost rank: uses the predicted state */
    c.outputs = m->outputs;
    if (p->nevents && (status = m->system->outputs(&c))) return status;
    for (int i = 0; i < p->nevents; ++i) g[i] = m->outputs[p->events[i].output] - p->events[i].level;
    if (!m->nheld) return 0;
    c.switches = m->switches;
    status = m->system->switches(&c);
    for (int i = 0; i < m->nheld; ++i) g[p->nevents + i] = ordernm_side(m, m->held[i]);
    return status;
}

/* Whether a monitored function crosses zero: an event's output minus its level, or a switching function that leaves its mode. */
static int crosses(const ordernm_motion *m, int number, scalar before, scalar after)
{
    if (number >= m->problem->nevents) return before >= 0.0 && after < 0.0;
    const ordernm_event *const e = m->problem->events + number;
    return (e->direction >= 0 && before < 0.0 && after >= 0.0) || (e->direction <= 0 && before > 0.0 && after <= 0.0);
}

static int within(ordernm_motion *m, scalar h, scalar part, scalar *g)
{
    m->method->interpolate(m, h, part, m->trial);
    return ordernm_crossings(m, m->t + part*h, m->trial, g);
}

/* Finds the smallest distance of an output from its level between three places, of which the middle one is the nearest (simplified Brent's
 * method: vertex of a parabola, or a cut of the larger part). Ends beyond the level if the output crosses the level. */
static int nearest(ordernm_motion *m, scalar h, int e, scalar at[3], scalar g[3])
{
    const scalar sign = g[1] > 0.0 ? 1.0 : -1.0;
    for (int n = 0; n < NEARER && sign*g[1] > 0.0 && at[2] - at[0] > 1e-9; ++n) {
        const scalar a = (g[1] - g[0])/(at[1] - at[0]), b = (g[2] - g[1])/(at[2] - at[1]), bend = (b - a)/(at[2] - at[0]);
        const scalar vertex = 0.5*(at[0] + at[1]) - 0.5*a/bend;
        const scalar wide = at[2] - at[1] > at[1] - at[0] ? at[1] + 0.38*(at[2] - at[1]) : at[1] - 0.38*(at[1] - at[0]);
        const scalar least = 1e-3*(at[2] - at[0]);
        scalar next = vertex > at[0] + least && vertex < at[2] - least && n%4 != 3 ? vertex : wide;
        if (fabs(next - at[1]) < 1e-9) next = at[1] + (at[2] - at[1] > at[1] - at[0] ? 1e-9 : -1e-9);
        const int status = within(m, h, next, m->within);
        if (status) return status;
        const scalar of = m->within[e];
        const int to_the_right = next > at[1], better = sign*of < sign*g[1];
        const int replaced = better == to_the_right ? 0 : 2;
        if (better) {
            at[replaced] = at[1], g[replaced] = g[1];
            at[1] = next, g[1] = of;
        } else {
            at[replaced] = next, g[replaced] = of;
        }
    }
    return 0;
}

/* Looks at place i of n for an extremum of a switching function that has the sign of its mode. If the extremum is zero, or smaller than
 * errors of the state may make it, the motion touches the switch. Does nothing without derivatives. Returns the status of a function. */
static int look_at_touch(ordernm_motion *m, scalar h, int e, const scalar *x, const scalar *y, int i, int n)
{
    const int number = e - m->problem->nevents, k = number < 0 ? 0 : m->held[number];
    if (number < 0 || m->system->switch_kind[k] > ORDERNM_ROOT || !(m->ngroups || m->results->steps)) return 0;
    scalar range = 0.0;
    for (int j = 0; j < n; ++j) range = fmax(range, fabs(y[j]));
    if (!(y[i] >= 0.0 && y[i] <= NEAR*range && y[i - 1] > y[i] && y[i + 1] > y[i])) return 0;
    int status = within(m, h, x[i], m->within);
    if (!status && y[i] > TOUCHING*range) status = ordernm_find_switch_errors(m, m->t + x[i]*h, m->trial);
    if (!status && (y[i] <= TOUCHING*range || y[i] <= ordernm_switch_error(m, k))) ordernm_touch(m, m->t + x[i]*h, k);
    return status;
}

/* Evaluates an output at a possible extremum, and searches its smallest distance from the level, among n places with known values.
 * Returns the status of a function. */
static int look_at_turn(ordernm_motion *m, scalar h, int e, scalar turn, scalar *x, scalar *y, int *n)
{
    int status, i = 1; /* the first known place at or after `turn` */
    while (i < *n - 1 && x[i] < turn) ++i;
    if (i > 1 && turn - x[i - 1] < SAME_PLACE) {
        --i;
    } else if (!(i < *n - 1 && x[i] - turn < SAME_PLACE)) {
        if ((status = within(m, h, turn, m->within))) return status;
        memmove(x + i + 1, x + i, (*n - i)*sizeof(scalar));
        memmove(y + i + 1, y + i, (*n - i)*sizeof(scalar));
        x[i] = turn, y[i] = m->within[e];
        ++*n;
    }
    for (int k = -1; k <= 1; k += 2) /* the extremum may be elsewhere, since the polynomial is only an approximation */
        if (i + k > 0 && i + k < *n - 1 && fabs(y[i + k]) < fabs(y[i])) i += k;
    if (y[i]*y[i - 1] > 0.0 && y[i]*y[i + 1] > 0.0 && fabs(y[i]) <= fabs(y[i - 1]) && fabs(y[i]) <= fabs(y[i + 1])) {
        scalar place[3] = {x[i - 1], x[i], x[i + 1]}, value[3] = {y[i - 1], y[i], y[i + 1]};
        if ((status = nearest(m, h, e, place, value))) return status;
        x[i] = place[1], y[i] = value[1];
    }
    return look_at_touch(m, h, e, x, y, i, *n);
}

/* The first part of a step in which an output crosses its level: the ends of this part, and the outputs at these ends. `found` receives
 * whether the output crosses its level. Returns the status of a function. */
static int bracket(ordernm_motion *m, scalar h, int e, scalar at[2], scalar g[2], int *found)
{
    const long events = m->nwatched;
    scalar x[MOST_PLACES], y[MOST_PLACES], turn[EVENT_SAMPLES];
    for (int i = 0; i <= PARTS; ++i) {
        x[i] = ordernm_event_point(i);
        y[i] = i == 0 ? m->crossing[e] : i == PARTS ? m->after[e] : m->samples[(i - 1)*events + e];
    }
    int n = PARTS + 1;
    const int turns = ordernm_extremes(y, turn);
    for (int i = 0; i < turns; ++i) {
        const int status = look_at_turn(m, h, e, turn[i], x, y, &n);
        if (status) return status;
    }
    *found = 0;
    for (int i = 0; i < n - 1 && !*found; ++i) {
        *found = crosses(m, e, y[i], y[i + 1]);
        at[0] = x[i], at[1] = x[i + 1];
        g[0] = y[i], g[1] = y[i + 1];
    }
    return 0;
}

/* Position of the first event in the step; 2 if there is none (Dekker's method with the Illinois modification, on the interpolant). */
static int locate(ordernm_motion *m, scalar h, scalar *first, int *which)
{
    *first = 2.0;
    for (int e = 0; e < m->nwatched; ++e) {
        scalar ends[2], values[2];
        int found;
        m->part[e] = 2.0;
        int status = bracket(m, h, e, ends, values, &found);
        if (status) return status;
        if (!found || ends[0] > *first) continue;
        if (*first < ends[1] && m->at_first[e]*values[0] > 0.0) continue; /* crosses after the first event */
        scalar low = ends[0], high = ends[1], g_low = values[0], g_high = values[1];
        for (int n = 0; n < 60 && high - low > 1e-14; ++n) {
            const int halve = n > 16 || n%8 == 7 || fabs(g_low) <= BEHIND; /* of g_low, only the sign is known */
            scalar at = halve ? 0.5*(low + high) : high - g_high*(high - low)/(g_high - g_low);
            if (!(at > low && at < high)) at = 0.5*(low + high);
            if (within(m, h, at, m->within)) { /* a loop has lost rank at this position, and speeds are undefined */
                at += 0.3*(high - at);
                if (within(m, h, at, m->within)) m->within[e] = 0.0;
            }
            const scalar g = m->within[e];
            if (g == 0.0) {
                low = high = at;
            } else if ((g > 0.0) == (g_high > 0.0)) {
                high = at;
                g_high = g;
                g_low *= 0.5;
            } else {
                low = at;
                g_low = g;
                g_high *= 0.5;
            }
        }
        m->part[e] = high;
        if (high < *first) {
            if (within(m, h, high, m->at_first)) memset(m->at_first, 0, m->nwatched*sizeof(scalar));
            *first = high;
            *which = e;
            for (int i = 0; i < 2; ++i) m->around_event[i] = ends[i]*h;
            const int far = fabs(values[1]) > fabs(values[0]); /* the farther end: at the nearer one, possibly only the sign is known */
            m->beside_event[0] = m->around_event[far];
            m->beside_event[1] = values[far];
        }
    }
    return 0;
}

/* A step to the expected time of an event. An implicit step, or the iteration of its derivatives, may fail to converge. */
static int step_of_size(ordernm_motion *m, scalar h)
{
    scalar *const error = &m->error_to_event;
    const int status = m->method->step(m, h, error);
    return !status && m->method->gives_rate && !(*error <= 1.0) ? -1 : status;
}

static int rates_at_end(ordernm_motion *m, scalar h)
{
    return m->method->gives_rate ? 0 : ordernm_rates_at_end(m, m->t + h, m->rate[m->method->stages]);
}

/* Repeats the step with other sizes until it ends at an event; the secant method gives the sizes. */
static int step_to_event(ordernm_motion *m, int e, scalar *h)
{
    scalar size = *h, before = m->beside_event[0], g_before = m->beside_event[1], best = INFINITY, found = *h;
    for (int n = 0; n < 8; ++n) {
        int status = step_of_size(m, size);
        if (!status) status = ordernm_crossings(m, m->t + size, m->next, m->within);
        if (status) return status;
        const scalar g = m->within[e];
        if (!(fabs(g) < best)) break;
        best = fabs(g);
        found = size;
        if (g == 0.0 || g == g_before) break;
        const scalar next = size - g*(size - before)/(g - g_before);
        before = size;
        g_before = g;
        if (!(next > m->around_event[0] && next <= m->around_event[1]) || fabs(next - size) <= 2e-16*size) break;
        size = next;
    }
    const int status = step_of_size(m, found);
    *h = found;
    return status;
}

/* Makes a step to an event with finite rates at its end. If rates at the event are not finite, as for x^3/abs(x) at zero, the step ends
 * just after the event. */
static int step_with_rates(ordernm_motion *m, int e, scalar whole, scalar *h)
{
    const scalar at = *h;
    int status = step_to_event(m, e, h);
    for (int n = 0;; ++n) {
        if (!status) status = rates_at_end(m, *h);
        if (!status && ordernm_all_finite(m->rate[m->method->stages], m->values)) return 0;
        if (n == PLACES_BEHIND || at*(1.0 + JUST_BEHIND[n]) > whole) return status ? status : -1;
        *h = at*(1.0 + JUST_BEHIND[n]);
        status = step_of_size(m, *h);
    }
}

/* Outputs between the ends of the step. */
static int take_samples(ordernm_motion *m, scalar h)
{
    int status = m->method->complete(m, h);
    if (status) return status;
    m->complete = 1;
    for (int i = 1; i < PARTS; ++i)
        if ((status = within(m, h, ordernm_event_point(i), m->samples + (i - 1)*m->nwatched))) return status;
    return 0;
}

/* Range of an event's output in the step, divided by the step size. */
static scalar pace(const ordernm_motion *m, scalar h, int e)
{
    scalar low = m->crossing[e], high = low;
    for (int i = 1; i < PARTS; ++i) {
        const scalar g = m->samples[(i - 1)*m->nwatched + e];
        low = fmin(low, g), high = fmax(high, g);
    }
    return (high - low)/h;
}

/* An event at a pose where a loop has lost rank. No step can end at such a pose, so the row of the event is interpolated. If the motion
 * does not stop there, the step continues beyond the pose. */
static int event_at_pose(ordernm_motion *m, scalar whole, scalar part, trial *step)
{
    const ordernm_problem *const p = m->problem;
    step->h = part*whole;
    step->event_time = m->t + step->h;
    int stop = 0, status = ordernm_beside(m, step->h, ordernm_describe, ordernm_event_size(p) - 1);
    if (status) return status;
    scalar cut = fmin(part + CUT_BEHIND, 1.0);
    for (int e = 0; e < m->nwatched; ++e) {
        if (m->part[e] <= part + 1e-13 && e >= p->nevents) {
            m->results->late = 1 + m->held[e - p->nevents];
            m->results->late_at = step->event_time;
        }
        if (m->part[e] <= part + 1e-13) stop |= e < p->nevents && p->events[e].stop;
        else if (m->part[e] < cut) cut = 0.5*(part + m->part[e]);
    }
    if (stop && m->results->steps) return -1; /* the adjoint cannot use an interpolated end */
    step->at_pose = stop;
    if (stop) return 0;
    step->h = whole*cut;
    if ((status = step_of_size(m, step->h))) return status;
    if ((status = rates_at_end(m, step->h))) return status;
    return ordernm_crossings(m, m->t + step->h, m->next, m->after);
}

/* Looks for events in the step; if there is one, the step ends there. */
int ordernm_look_for_events(ordernm_motion *m, trial *step)
{
    const ordernm_problem *const p = m->problem;
    const scalar whole = step->h;
    scalar part;
    m->row_known = 0;
    int status = ordernm_crossings(m, m->t + whole, m->next, m->after);
    if (!status) status = take_samples(m, whole);
    if (!status) status = locate(m, whole, &part, &step->event);
    if (status || step->event < 0) return status;
    for (int e = 0; e < m->nwatched; ++e) m->paces[e] = pace(m, whole, e);
    m->complete = 0;
    status = within(m, whole, part, m->within);
    /* a longer step would use the wrong branch after a switch */
    const scalar worst = step->event < p->nevents ? m->too_poor : fmax(m->too_poor, m->hopeless);
    if (m->nd && (status || m->results->condition_here > worst)) {
        if ((status = event_at_pose(m, whole, part, step))) return status;
    } else {
        step->h = part*whole;
        if ((status = step_with_rates(m, step->event, whole, &step->h))) return status;
        step->event_time = m->t + step->h;
        if ((status = ordernm_crossings(m, m->t + step->h, m->next, m->after))) return status;
    }
    /* all events at this time count as passed, even if rounding has left the output before its level. The step is more accurate than its
     * interpolant, so an event that the step's end has passed counts even if the interpolant has not passed it. Recent events remain
     * passed. */
    for (int e = 0; e < m->nwatched; ++e) {
        const int recent = fabs(m->crossing[e]) == BEHIND && part < 1e-9;
        if (m->part[e] <= part + 1e-13 || (crosses(m, e, m->crossing[e], m->after[e]) && !recent)) {
            const int way = e < p->nevents ? p->events[e].direction : -1;
            const scalar behind = way ? way : m->crossing[e] < 0.0 ? 1.0 : -1.0;
            m->happened[e] = 1.0;
            if (!(m->row_known && m->after[e]*behind > 0.0)) m->after[e] = behind*BEHIND;
        } else {
            m->happened[e] = 0.0;
            if (recent) m->after[e] = m->crossing[e];
        }
    }
    for (int e = 0; e < p->nevents; ++e) /* the same output may have events with other directions */
        for (int f = 0; m->happened[e] > 0.0 && f < p->nevents; ++f)
            if (m->happened[f] == 0.0 && p->events[f].output == p->events[e].output && p->events[f].level == p->events[e].level)
                m->after[f] = m->after[e];
    return 0;
}

/* Events of outputs that jump over their level between two steps, with an input or at a switch. */
int ordernm_jumped_events(ordernm_motion *m, int by_state, int *stop)
{
    const ordernm_problem *const p = m->problem;
    ordernm_results *const r = m->results;
    const long size = ordernm_event_size(p);
    int status = ordernm_crossings(m, m->t, m->z, m->within);
    for (int e = 0; e < p->nevents && !status; ++e) {
        if (fabs(m->crossing[e]) == BEHIND && !(crosses(m, e, m->crossing[e], m->within[e]) && fabs(m->within[e]) > 0.0)) continue;
        const int jumped = crosses(m, e, m->crossing[e], m->within[e]);
        m->crossing[e] = m->within[e];
        if (!jumped) continue;
        *stop |= p->events[e].stop;
        if (!r->events) continue;
        scalar *const row = r->events + r->events_count*size;
        if ((status = ordernm_describe(m, m->t, m->z, row))) break;
        scalar *const times = row + size - 1 - p->ndirections;
        for (int k = 0; k < p->ndirections; ++k) times[k] = by_state ? m->switch_time[k/LANES*LANES + k%LANES] : 0.0;
        row[size - 1] = by_state ? ORDERNM_JUMPED_BY_STATE : ORDERNM_JUMPED;
        r->which[r->events_count++] = e;
    }
    return status;
}

/* Stores the events at the end of the step; several may occur at the same time. `stop` receives whether the motion stops there.
 * Returns the status of a function. */
int ordernm_keep_events(ordernm_motion *m, const trial *step, int *stop)
{
    const ordernm_problem *const p = m->problem;
    ordernm_results *const r = m->results;
    const long size = ordernm_event_size(p);
    *stop = 0;
    for (int e = 0; step->event >= 0 && e < p->nevents; ++e) {
        if (m->happened[e] == 0.0) continue;
        *stop |= p->events[e].stop;
        if (!r->events) continue;
        scalar *const row = r->events + r->events_count*size;
        const int status = m->row_known ? 0 : ordernm_describe(m, step->event_time, m->next, row);
        if (status) return status;
        if (m->row_known) memcpy(row, m->known_row, (size - 1)*sizeof(scalar));
        row[size - 1] = m->paces[e];
        const int unknown = ordernm_compare_with_front(m, e, row);
        if (unknown) return unknown;
        r->which[r->events_count++] = e;
    }
    return 0;
}
