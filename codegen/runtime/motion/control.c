/* A motion from start to end: steps are tried, rejected and accepted. */
#include "inside.h"

#include <math.h>
#include <string.h>
#include <time.h>

enum { CLOCK_STEPS = 16 };    /* number of steps between two readings of the clock */

/* A motion counts as stuck if it advances by less than the fraction STUCK of its duration in this number of steps. */
enum { STUCK_STEPS = 2000 };
static const scalar STUCK = 1e-9;

/* Switches count as accumulating if this number of them is passed in a short time. */
enum { MOST_PASSED = 100 };

/* Factor by which the condition number must grow before other independent coordinates are considered again. */
static const scalar LOOK_AGAIN = 3.0;

/* Maximum number of repetitions of a step because a stage is too near to a pose where a loop loses rank. */
enum { MOST_MOVES = 3 };
static const scalar AT_POSE = 0.005; /* relative distance of the pose from the step's end, below which the step ends at the pose */
static const scalar LEAST_MOVE = 0.02; /* smallest shift of the step's end, relative to the step, for which a step is repeated */

/* A step that approaches a dead point covers at most the fraction SHORT of the distance, until the condition number exceeds NEAR_ENOUGH.
 * MOST_REFUSED is the maximum number of repetitions of a step. */
static const scalar SHORT = 0.9, NEAR_ENOUGH = 100.0;
enum { MOST_REFUSED = 8 };

static double seconds_now(void)
{
    struct timespec now = {0};
    timespec_get(&now, TIME_UTC);
    return now.tv_sec + 1e-9*now.tv_nsec;
}

static int begin(ordernm_motion *m)
{
    const ordernm_problem *const p = m->problem;
    ordernm_find_segment(m, m->t, 1e-12*(1.0 + fabs(m->t)));
    if (ordernm_settle(m, m->t, m->z) < 0) return ordernm_failed(m->results, -1);
    ordernm_note_condition(m, 0, 0);
    ordernm_note_best(m);
    int status = ordernm_reach_knot(m);
    if (!status && m->nheld) status = ordernm_choose_modes(m, m->t, m->z);
    if (!status) status = ordernm_rates(m, m->t, m->z, m->rate[0]);
    if (!status && m->flowing) status = ordernm_begin_flow(m);
    ordernm_note_precise(m, 0);
    if (ordernm_wants_precise(m)) return ORDERNM_IMPRECISE;
    if (status) return ordernm_failed(m->results, status);
    if (!ordernm_all_finite(m->rate[0], m->values)) return ordernm_not_finite(m, m->rate[0]);
    const int root = m->nheld && m->derived ? ordernm_begin_at_root(m) : -1;
    if (root >= 0) ordernm_doubt_start(m, root);
    ordernm_lose_infinite(m, m->rate[0]);
    ordernm_note_condition(m, 0, 0);
    int unknown = p->nevents ? ordernm_crossings(m, m->t, m->z, m->crossing) : 0;
    if (!unknown && m->nheld) unknown = ordernm_sides(m, m->t, m->z, m->crossing + p->nevents);
    if (!unknown && m->nheld) unknown = ordernm_limit_turns(m);
    if (unknown) return ordernm_failed(m->results, unknown);
    if (!p->ntimes || p->times[0] <= p->start) {
        const int reason = ordernm_keep(m, m->t, m->z);
        if (reason != ORDERNM_ENDED) return reason;
        m->sampled = p->ntimes ? 1 : 0;
    }
    if (m->nheld) ordernm_lose_at_start(m);
    m->h = p->step;
    if (m->h <= 0.0) {
        const scalar limit = fmin(p->end - p->start, p->largest_step > 0.0 ? p->largest_step : INFINITY);
        const int failure = ordernm_first_step(m, limit, &m->h);
        if (failure) m->h = 1e-6*limit; /* the error of the first trial step then sets the step size */
    }
    m->begun = 1;
    return ORDERNM_ENDED;
}

/* ---- Single steps. ---- */

/* Interpolates the results if the motion ends where a loop has lost rank. Returns whether it ends there. */
static int end_at_pose(ordernm_motion *m, trial *step)
{
    if (m->results->steps) return 0; /* the adjoint cannot use an interpolated end */
    if (!step->to_wall || step->end != m->problem->end) return 0;
    const int last = m->method->gives_rate ? m->method->stages - 1 : m->method->stages; /* index of the stage at the end of the step */
    if (!(fabs(m->pose - step->end) <= AT_POSE*step->h || m->conditions[last] > m->hopeless)) return 0;
    step->at_pose = !ordernm_beside(m, step->h, ordernm_report, ordernm_row_size(m->problem));
    if (step->at_pose) {
        step->error = 0.0;
        return 1;
    }
    m->row_known = 0; /* the interpolated row belongs to a step of another size */
    const scheme *const method = m->method;
    const int status = method->step(m, step->h, &step->error);
    if (!status && step->error <= 1.0 && !method->gives_rate) ordernm_rates_at_end(m, step->end, m->rate[method->stages]);
    return 0;
}

/* Whether a dropped condition is open by more than its limit at the end of the step. */
static int comes_apart(ordernm_motion *m, const trial *step)
{
    if (!m->system->ndropped) return 0;
    if (m->method->gives_rate) { /* an implicit method has not closed the loops at the end of the step yet */
        const scalar condition = m->results->condition_here;
        ordernm_call c;
        ordernm_arguments(m, step->end, m->next, &c);
        if (ordernm_close_loops(m, &c)) return 0;
        m->results->condition_here = condition;
        m->apart_at_end = m->apart;
    }
    return !(m->apart_at_end <= m->system->apart);
}

/* Errors of derivatives below this limit do not affect the next step. */
static const scalar SMALL = 0.01;

/* Counts errors of derivatives along the motion as errors of a step, except near a singular point or without held modes, where
 * other functions examine them. */
static void count_flow(ordernm_motion *m, trial *step)
{
    const scalar error = ordernm_error_along_flow(m, step->h, step->error, m->rate[m->method->stages]);
    if (!(error > fmax(step->error, SMALL))) return;
    for (int i = 0; i < m->nheld; ++i)
        if (m->let_go[m->held[i]] != 0.0) return;
    if (error > 1.0 && ordernm_near_point(m, step)) return;
    step->error = error;
    if (m->advice > 1.0) m->advice = 0.0; /* an implicit method's advice ignores this larger error */
}

/* For a constant step, adds the error of derivatives along the motion to the results; the error is relative to the rates. */
static void note_flow(ordernm_motion *m, const trial *step)
{
    ordernm_results *const r = m->results;
    if (!(ordernm_error_along_flow(m, step->h, 1.0, m->rate[m->method->stages]) > 1.0) || ordernm_near_point(m, step)) return;
    r->coarse_along += m->flow_error;
    if (m->flow_error > r->coarsest_along) r->coarsest_along = m->flow_error, r->coarse_along_at = m->t;
}

/* Tries a step. Returns the status of a function, or -1 if loops do not close or close on another branch. */
static int attempt(ordernm_motion *m, trial *step)
{
    const ordernm_problem *const p = m->problem;
    const scheme *const method = m->method;
    scalar *const rate = m->rate[method->stages];
    m->advice = 0.0;
    m->root = -1;
    m->row_known = m->complete = m->closed_known = 0;
    for (int i = 1; i < MOST_STAGES; ++i) m->conditions[i] = 0.0;
    if (m->flowing) ordernm_set_flow(m);
    int status = method->step(m, step->h, &step->error);
    if (p->fixed && step->error < INFINITY) step->error = 0.0;
    if (!method->gives_rate && !status && step->error > 1.0 && step->error < INFINITY && ordernm_rounded_at_pose(m, step->h, step->error))
        step->error = 1.0;
    int good = !status && step->error <= 1.0;
    if (good && !method->gives_rate) {
        status = ordernm_rates_at_end(m, step->end, rate);
        ordernm_note_condition(m, method->stages, status);
    }
    if (m->nd && method->gap > 0.0) {
        const int too_near = ordernm_find_pose(m, step->h);
        if (end_at_pose(m, step)) return 0;
        const scalar elsewhere = ordernm_step_at_pose(m, step->h, step->wall);
        /* the last stage of an implicit step is the end of the step */
        const int moves = method->gives_rate ? good || status : too_near;
        step->again = moves && m->moved < MOST_MOVES && fabs(elsewhere - step->h) > LEAST_MOVE*step->h;
    }
    if (status || step->again || !good) return status;
    if (m->nd && m->adaptive && ordernm_jumped(m, m->next)) return -1;
    if (!ordernm_all_finite(rate, m->values)) step->error = NAN;
    if (m->flowing && m->adaptive) count_flow(m, step);
    if (!(step->error <= 1.0)) return 0;
    if (m->nd && (step->dead = ordernm_dead_point_within(m, step->h)) > 0.0) return 0;
    if ((step->apart = comes_apart(m, step))) return 0;
    if (!m->nwatched) return 0;
    const scalar whole = step->h;
    status = ordernm_look_for_events(m, step);
    if (status) return status;
    if (m->derived) {
        const scalar larger = ordernm_error_beside_powers(m, step, step->event < 0 ? step->error : m->error_to_event);
        if (larger > 1.0 && !m->adaptive) {
            m->shorter = m->advice*step->h;
            return step->again = 1, 0;
        }
        if (larger > 1.0 || (step->event < 0 && larger > step->error)) step->error = larger;
        if (step->error == larger && m->advice > 1.0) m->advice = 0.0; /* an implicit method's advice ignores this larger error */
        if (larger > 1.0) return 0;
        if (m->root >= 0 && m->ngroups && (status = ordernm_beside_root(m, step))) return status;
    }
    if (step->event < 0) return 0;
    step->to_wall = 0;
    step->end = m->t + step->h;
    if (fabs(step->wall - step->end) <= 1e-15*fabs(step->wall)) step->end = step->wall;
    m->h = whole; /* the next step has the size that this step had before it was cut */
    return status;
}

/* A step after which a dropped condition is open by too much is repeated with a smaller size, down to this fraction of the duration. */
static const scalar BEFORE_APART = 1e-5;

/* Repeats a step after which a dropped condition is too far open, with a smaller size; returns the reason for the end if the size is already small. */
static int end_together(ordernm_motion *m, const trial *step)
{
    ++m->results->rejected;
    m->results->component = m->widest;
    if (!m->adaptive || step->h < BEFORE_APART*(m->problem->end - m->problem->start)) return ORDERNM_APART;
    m->h = 0.5*step->h;
    m->rejected_before = 1;
    return ORDERNM_ENDED;
}

/* Repeats a step over a dead point with a size that ends before the point, where other independent coordinates may be chosen. Returns the
 * reason for the end if the step is already near enough. */
static int end_short(ordernm_motion *m, const trial *step)
{
    ++m->results->rejected;
    if (m->conditions[0] > NEAR_ENOUGH || ++m->refused > MOST_REFUSED) return ORDERNM_UNDETERMINED;
    m->shorter = SHORT*step->dead*step->h;
    if (m->adaptive) m->h = m->shorter;
    m->rejected_before = 1;
    return ORDERNM_ENDED;
}

/* Constant steps do not shrink at large condition numbers. Returns whether other independent coordinates must be considered before this
 * step. */
static int passes_poor_poses(ordernm_motion *m)
{
    const ordernm_problem *const p = m->problem;
    scalar worst = 0.0;
    if (!(p->poor > 0.0)) return 0;
    for (int i = 1; i <= m->method->stages; ++i) worst = fmax(worst, m->conditions[i]);
    if (!(worst > fmax(p->poor, LOOK_AGAIN*m->looked_at))) return 0;
    m->results->condition_here = worst;
    return 1;
}

/* Whether rates at a stage of the last trial, or at its end, are not finite. An implicit step may also fail because its iteration diverges. */
static int is_undefined(const ordernm_motion *m)
{
    for (int i = 1; i <= m->method->stages; ++i)
        if (!ordernm_all_finite(m->rate[i], m->values)) return 1;
    return 0;
}

/* Sets the size of the next trial after a failed step or too large an error. Returns the reason for the end if no smaller step is possible.
 * */
static int refuse(ordernm_motion *m, const trial *step, int status)
{
    const ordernm_problem *const p = m->problem;
    ordernm_results *const r = m->results;
    const scheme *const method = m->method;
    if (m->nheld && (status || (step->error != step->error && is_undefined(m))) && ordernm_let_go(m)) {
        ++r->rejected;
        return ORDERNM_ENDED; /* repeats the step, with every switch in the branch of the current state */
    }
    if (!m->adaptive) {
        if (status) return ordernm_failed(r, status);
        return method->gives_rate ? ORDERNM_COLLAPSED : ordernm_not_finite(m, m->rate[method->stages]);
    }
    ++r->rejected;
    r->component = ordernm_worst_entry(m);
    const scalar change = ordernm_after_failure(m, status ? NAN : step->error);
    /* ignores advice to enlarge the step: the method has not detected the reason for the rejection */
    m->h = step->h*(m->advice > 0.0 && m->advice < 1.0 ? m->advice : change);
    m->rejected_before = 1;
    if (!status && m->pose > m->t && m->pose < step->end) {
        m->refused_pose = m->pose;
        m->refused_step = step->h;
        m->refused_error = step->error;
    }
    if (m->h > 1e-15*fmax(fabs(m->t), fabs(p->end - p->start))) return ORDERNM_ENDED;
    return status ? ordernm_failed(r, status) : ORDERNM_COLLAPSED;
}

static int go_on(ordernm_motion *m, const trial *step, int *stop)
{
    ordernm_results *const r = m->results;
    r->t = step->end;
    const ordernm_problem *const p = m->problem;
    ordernm_exchange(&m->crossing, &m->after);
    for (int i = 0; i < m->nheld; ++i)
        m->crossed[m->held[i]] = step->event >= 0 && m->happened[p->nevents + i] > 0.0 ? fmax(m->paces[p->nevents + i], 1e-300) : 0.0;
    int failure = ordernm_next_step(m, step->end, step->knot, step->at_pose, 0);
    const int at_knot = ordernm_next_knot(m, m->t) != step->knot;
    if (!failure) ordernm_lose_infinite(m, m->z);
    if (!failure && m->nbent) ordernm_lose_at_knot(m);
    if (!failure && m->nheld && r->lost) ordernm_look_at_samples(m);
    if (!failure && m->nheld && (m->switched || at_knot)) failure = ordernm_sides(m, m->t, m->z, m->crossing + p->nevents);
    if (!failure && p->nevents && m->switched) failure = ordernm_compare_events(m);
    if (!failure && p->nevents && (m->switched || at_knot)) failure = ordernm_jumped_events(m, !at_knot, stop);
    if (!failure && m->nheld) failure = ordernm_limit_turns(m);
    if ((failure == SLIDES || failure == REFUSED) && !p->ntimes) ordernm_keep(m, m->t, m->z);
    if (failure) return ordernm_failed(r, failure);
    r->next_step = m->h;
    return m->problem->ntimes ? ORDERNM_ENDED : ordernm_keep(m, m->t, m->z);
}

/* An event ends the motion: stores the state as a step of size zero, for weights after a jump. */
static int end_at_event(ordernm_motion *m)
{
    ordernm_results *const r = m->results;
    m->stopped = 1;
    if (r->steps && r->steps_count == r->steps_capacity) return ORDERNM_FULL;
    if (r->steps) ordernm_keep_step(m, 0.0);
    return ORDERNM_EVENT;
}

/* Completes an accepted step. */
static int accept(ordernm_motion *m, const trial *step)
{
    const ordernm_problem *const p = m->problem;
    ordernm_results *const r = m->results;
    int stop, reason;
    m->moved = m->refused = m->not_held = 0;
    m->shorter = 0.0;
    if (p->method == ORDERNM_DOP853 && step->event < 0) ordernm_watch_stability(m, step); /* the last stage is still available */
    ordernm_look_for_lost(m, step);
    if (p->ntimes && (reason = ordernm_sample(m, step->end)) != ORDERNM_ENDED) return reason;
    ++r->accepted;
    ordernm_note_coarse(m, step->h);
    if (m->flowing && p->method == ORDERNM_RK4) note_flow(m, step);
    if (m->flat[0] > m->t && m->flat[0] <= step->end && r->flat_count < r->flat_capacity)
        memcpy(r->flat + r->flat_count++*(1 + 2L*m->system->nq), m->flat, (1 + 2L*m->system->nq)*sizeof(scalar));
    if (r->steps) ordernm_keep_step(m, step->h);
    const int unknown = ordernm_keep_events(m, step, &stop);
    if (unknown) return ordernm_failed(r, unknown);
    ordernm_resize(m, step);
    if ((reason = go_on(m, step, &stop)) != ORDERNM_ENDED) return reason;
    if (stop) return end_at_event(m);
    if (m->switched) return ORDERNM_ENDED; /* the next step determines what has changed */
    if (r->condition_here <= p->poor) m->looked_at = 0.0;
    const int poor = p->poor > 0.0 && r->condition_here > fmax(p->poor, LOOK_AGAIN*m->looked_at);
    if (poor && m->t < p->end) return ORDERNM_POOR;
    return m->nd && r->condition_here > m->poor && ordernm_undetermined(m) ? ORDERNM_UNDETERMINED : ORDERNM_ENDED;
}

/* Whether the memory for results is too small for the results of one more step. */
static int is_full(const ordernm_motion *m)
{
    const ordernm_problem *const p = m->problem;
    const ordernm_results *const r = m->results;
    return (!p->ntimes && r->count == r->capacity) || (r->steps && r->steps_count == r->steps_capacity)
           || (r->events && r->events_count + 2*p->nevents > r->events_capacity);
}

/* Whether the motion does not advance because steps are too small. */
static int is_stuck(ordernm_motion *m)
{
    ordernm_results *const r = m->results;
    const long made = r->accepted + r->rejected;
    if (made == 0 || made%STUCK_STEPS || made == m->marked) return 0;
    const int stuck = m->t - m->mark < STUCK*(m->problem->end - m->problem->start);
    m->mark = m->t;
    m->marked = made;
    if (stuck) r->component = ordernm_worst_entry(m);
    return stuck;
}

int ordernm_go(ordernm_motion *m, ordernm_results *r, double seconds)
{
    const ordernm_problem *const p = m->problem;
    const double deadline = seconds > 0.0 ? seconds_now() + seconds : INFINITY;
    int reason = ORDERNM_ENDED;
    m->results = r;
    r->t = m->t;
    if (m->stopped) return end_at_event(m);
    if (!m->begun) {
        if (m->ngroups || r->steps) ordernm_take_derivatives(m, INFINITY);
        if (r->capacity < 1) return ORDERNM_FULL;
        reason = begin(m);
    }
    for (long n = 1; reason == ORDERNM_ENDED && m->t < p->end; ++n) {
        if (is_full(m)) return ORDERNM_FULL;
        if (p->most_steps && r->accepted + r->rejected >= p->most_steps) return ORDERNM_MANY_STEPS;
        if (m->nheld && m->passed >= MOST_PASSED && ordernm_accumulates(m)) return ORDERNM_ACCUMULATED;
        if (is_stuck(m)) return ORDERNM_COLLAPSED;
        if (n%CLOCK_STEPS == 0 && seconds_now() > deadline) return ORDERNM_PAUSED;
        trial step;
        if ((reason = ordernm_plan(m, &step)) != ORDERNM_ENDED) break;
        const int status = attempt(m, &step);
        if (ordernm_wants_precise(m)) return ORDERNM_IMPRECISE;
        if (step.again) {
            ++r->rejected;
            ++m->moved;
            continue;
        }
        if (!m->adaptive && passes_poor_poses(m)) {
            ++r->rejected;
            return ORDERNM_POOR;
        }
        if (step.dead > 0.0) {
            reason = end_short(m, &step);
            continue;
        }
        if (step.apart) {
            reason = end_together(m, &step);
            continue;
        }
        reason = status || !(step.error <= 1.0) ? refuse(m, &step, status) : accept(m, &step);
    }
    return reason == ORDERNM_COLLAPSED && m->nheld && ordernm_accumulates(m) ? ORDERNM_ACCUMULATED : reason;
}
