/* A motion from its beginning to its end: memory, the size of steps, what happens between them. */
#include "inside.h"

#include <math.h>
#include <string.h>
#include <time.h>

enum { CLOCK_STEPS = 16 };    /* the clock is read once in so many steps */

/* How far an output is from the level that it has just crossed: behind it, whatever rounding says. */
static const double BEHIND = 1e-300;

static const double SAFETY = 0.9, LEAST_CHANGE = 0.333, LARGEST_CHANGE = 6.0, AFTER_FAILURE = 0.25;

/* ---- Memory. ---- */

static long whole_lines(long n) { return (n + 7)/8*8; }

static const method *method_of(const ordernm_problem *p)
{
    return p->method == ORDERNM_RK4 ? &ordernm_rk4 : &ordernm_dop853;
}

/* Lays a motion out; m is 0 where only its size is asked for. */
static size_t lay_out(const ordernm_problem *p, void *at)
{
    memory of = {at, 0};
    const ordernm_system *s = p->system;
    ordernm_motion none, *m = ordernm_take(&of, sizeof *m);
    if (!at) m = &none;
    memset(m, 0, sizeof *m);
    m->problem = p;
    m->system = s;
    m->method = method_of(p);
    m->ny = s->nfree_q + s->nfree_u;
    m->nx = p->nintegrals;
    m->nd = s->nq - s->nfree_q;
    m->identity = !s->closing_step;
    m->values = whole_lines(m->ny + m->nx + m->nd);
    m->ngroups = (p->ndirections + LANES - 1)/LANES;
    m->groups = ordernm_take(&of, (m->ngroups + 1)*sizeof(group));
    m->size = m->values;
    for (int n = 0; n < m->ngroups; ++n) {
        const int left = p->ndirections - n*LANES;
        const int width = left == 1 ? 1 : LANES;
        group g = {width, width == LANES, n*LANES, left < LANES ? left : LANES, m->size, ordernm_numbers(&of, s->np*width)};
        m->size += whole_lines((long)(m->ny + m->nx)*width);
        if (at) m->groups[n] = g;
    }
    m->dependent = ordernm_take(&of, (m->nd + 1)*sizeof(int));
    for (int i = 0; i < m->method->all; ++i) m->rate[i] = ordernm_numbers(&of, m->size);
    double **states[] = {&m->z, &m->next, &m->trial, &m->zeros, m->error, m->error + 1};
    for (size_t i = 0; i < sizeof states/sizeof *states; ++i) *states[i] = ordernm_numbers(&of, m->size);
    m->work = ordernm_numbers(&of, s->workspace);
    if (s->closing_step)
        m->precise_work = ordernm_take(&of, (s->workspace + 2L*s->nq + s->np + s->nclosure + s->nloops)*sizeof(long double));
    double **of_q[] = {&m->q, &m->qdot, &m->newton}, **of_u[] = {&m->u, &m->udot};
    double **lanes_q[] = {&m->dq, &m->dqdot, &m->full_dq}, **lanes_u[] = {&m->du, &m->dudot, &m->full_du};
    const long wider = s->nq > s->nu ? s->nq : s->nu; /* qdot is the place of speeds too */
    for (int i = 0; i < 3; ++i) *of_q[i] = ordernm_numbers(&of, wider);
    for (int i = 0; i < 2; ++i) *of_u[i] = ordernm_numbers(&of, s->nu);
    for (int i = 0; i < 3; ++i) *lanes_q[i] = ordernm_numbers(&of, s->nq*LANES), *lanes_u[i] = ordernm_numbers(&of, s->nu*LANES);
    m->position = ordernm_numbers(&of, s->nclosure);
    m->condition = ordernm_numbers(&of, s->nloops);
    m->outputs = ordernm_numbers(&of, s->noutputs);
    m->doutputs = ordernm_numbers(&of, s->noutputs*LANES);
    m->inputs = ordernm_numbers(&of, s->ninputs);
    m->dinputs = ordernm_numbers(&of, s->ninputs*LANES);
    m->dt = ordernm_numbers(&of, LANES);
    m->row = ordernm_numbers(&of, ordernm_row_size(p));
    double **of_events[] = {&m->crossing, &m->after, &m->within, &m->part};
    for (int i = 0; i < 4; ++i) *of_events[i] = ordernm_numbers(&of, p->nevents);
    return of.used;
}

long ordernm_room(const ordernm_problem *problem)
{
    return (long)(lay_out(problem, 0)/sizeof(double)) + 8;
}

long ordernm_row_size(const ordernm_problem *p)
{
    const ordernm_system *s = p->system;
    const long n = s->nq + s->nu + s->noutputs + p->nintegrals;
    return 1 + n*(1 + p->ndirections);
}

long ordernm_step_size(const ordernm_problem *p)
{
    const ordernm_system *s = p->system;
    return 2 + s->nq + s->nfree_u + p->nintegrals;
}

ordernm_motion *ordernm_begin(const ordernm_problem *p, double *room)
{
    void *const line = ordernm_line(room);
    memset(line, 0, lay_out(p, 0));
    lay_out(p, line);
    ordernm_motion *const m = line;
    const ordernm_system *const s = p->system;
    for (int i = 0, free = 0, n = 0; i < s->nq; ++i) {
        if (free < s->nfree_q && s->free_q[free] == i) ++free;
        else m->dependent[n++] = i;
    }
    for (int i = 0; i < s->nfree_q; ++i) m->z[i] = p->q[s->free_q[i]];
    for (int i = 0; i < s->nfree_u; ++i) m->z[s->nfree_q + i] = p->u[s->free_u[i]];
    for (int i = 0; i < m->nd; ++i) m->z[m->ny + m->nx + i] = p->q[m->dependent[i]];
    for (int n = 0; n < m->ngroups; ++n) {
        const group *const g = m->groups + n;
        double *const S = m->z + g->at;
        for (int l = 0; l < g->used; ++l) {
            const long k = g->first + l;
            for (int i = 0; p->dq && i < s->nfree_q; ++i) S[i*g->width + l] = p->dq[k*s->nq + s->free_q[i]];
            for (int i = 0; p->du && i < s->nfree_u; ++i)
                S[(s->nfree_q + i)*g->width + l] = p->du[k*s->nu + s->free_u[i]];
            for (int i = 0; p->dp && i < s->np; ++i) g->dp[i*g->width + l] = p->dp[k*s->np + i];
        }
    }
    m->t = p->start;
    /* rounding of conditions moves dependents in proportion to the condition, and rates to its square */
    m->poor = sqrt(0.01*p->rtol/2.2e-16);
    return m;
}

void ordernm_state(const ordernm_motion *m, double *q, double *u)
{
    const ordernm_system *s = m->system;
    for (int i = 0; i < s->nfree_q; ++i) q[s->free_q[i]] = m->z[i];
    for (int i = 0; i < m->nd; ++i) q[m->dependent[i]] = m->z[m->ny + m->nx + i];
    for (int i = 0; i < s->nu; ++i) u[i] = 0.0;
    for (int i = 0; i < s->nfree_u; ++i) u[s->free_u[i]] = m->z[s->nfree_q + i];
}

int ordernm_row(ordernm_motion *m, ordernm_results *results, double *row)
{
    m->results = results;
    ordernm_find_segment(m, m->t, 1e-9*(1.0 + fabs(m->t)));
    return ordernm_report(m, m->t, m->z, row);
}

/* ---- Errors. ---- */

/* The mean square of n errors in units of what is allowed: absolute, and relative to the larger of two sizes. */
static double mean_square(long n, long step, const double *error, const double *a, const double *b, const double *atol,
    int same, double rtol)
{
    double sum = 0.0;
    for (long i = 0; i < n; ++i) {
        const double x = fabs(a[i*step]), y = fabs(b[i*step]);
        const double of = error[i*step]/(atol[same ? 0 : i] + rtol*(x > y ? x : y));
        sum += of*of;
    }
    return n ? sum/n : 0.0;
}

/* One error of two, after E. Hairer: the first, made smaller where the second is large. */
static double of_both(double first, double second)
{
    const double both = first + 0.01*second;
    return both > 0.0 || both != both ? first/sqrt(both) : 0.0;
}

/* The error of a step in units of what is allowed: the largest of those of the state and of each direction. */
double ordernm_error_norm(const ordernm_motion *m, const double *next, const double *error, const double *second)
{
    const ordernm_problem *const p = m->problem;
    const long n = m->ny + m->nx;
    const double state = mean_square(n, 1, error, m->z, next, p->atol, 0, p->rtol);
    const double other = mean_square(n, 1, second, m->z, next, p->atol, 0, p->rtol);
    double largest = of_both(state, other);
    if (!p->atol_directions || !(largest == largest)) return largest;
    for (int g = 0; g < m->ngroups; ++g) {
        const group *const of = m->groups + g;
        for (int l = 0; l < of->used; ++l) {
            const double *const atol = p->atol_directions + of->first + l;
            const long at = of->at + l;
            const double one = mean_square(n, of->width, error + at, m->z + at, next + at, atol, 1, p->rtol);
            const double two = mean_square(n, of->width, second + at, m->z + at, next + at, atol, 1, p->rtol);
            const double direction = of_both(one, two);
            if (!(direction <= largest)) largest = direction;
        }
    }
    return largest;
}

/* The entry of the state whose error is largest in the step that was tried last, or that is not finite. */
static int worst_entry(const ordernm_motion *m)
{
    const ordernm_problem *const p = m->problem;
    int worst = 0;
    double largest = -1.0;
    for (int i = 0; i < m->ny + m->nx; ++i) {
        const double of = fabs(m->error[0][i])/(p->atol[i] + p->rtol*fabs(m->z[i]));
        if (!(of <= largest)) largest = of, worst = i;
        if (of != of) break;
    }
    return worst;
}

/* ---- Steps. ---- */

/* The first step (E. Hairer, S. P. Norsett, G. Wanner, section II.4). Returns what a function returned. */
static int first_step(ordernm_motion *m, double limit, double *h)
{
    const ordernm_problem *const p = m->problem;
    const int n = m->ny + m->nx;
    double size = 0.0, rate = 0.0, bend = 0.0;
    for (int i = 0; i < n; ++i) {
        const double scale = p->atol[i] + p->rtol*fabs(m->z[i]);
        size += m->z[i]/scale*(m->z[i]/scale);
        rate += m->rate[0][i]/scale*(m->rate[0][i]/scale);
    }
    size = sqrt(size/n);
    rate = sqrt(rate/n);
    double first = size < 1e-5 || rate < 1e-5 ? 1e-6 : 0.01*size/rate;
    if (first > limit) first = limit;
    static const int which[] = {0};
    static const double one[] = {1.0};
    ordernm_combine(m->size, m->trial, m->z, first, 1, which, one, m->rate);
    const int status = ordernm_rates(m, m->t + first, m->trial, m->rate[1]);
    if (status) return status;
    for (int i = 0; i < n; ++i) {
        const double scale = p->atol[i] + p->rtol*fabs(m->z[i]);
        const double of = (m->rate[1][i] - m->rate[0][i])/scale;
        bend += of*of;
    }
    bend = sqrt(bend/n)/first;
    const double steepest = bend > rate ? bend : rate;
    const double second = steepest <= 1e-15 ? (first*1e-3 > 1e-6 ? first*1e-3 : 1e-6)
                                            : pow(0.01/steepest, 1.0/m->method->order);
    *h = 100.0*first < second ? 100.0*first : second;
    return 0;
}

static double seconds_now(void)
{
    struct timespec now = {0};
    timespec_get(&now, TIME_UTC);
    return now.tv_sec + 1e-9*now.tv_nsec;
}

static void keep_row(ordernm_results *r, const double *row, long size)
{
    memcpy(r->rows + r->count*size, row, size*sizeof(double));
    ++r->count;
}

/* Why rates could not be computed. */
static int failed(ordernm_results *r, int status)
{
    r->singular = status;
    return status < 0 ? ORDERNM_OPEN : ORDERNM_SINGULAR;
}

/* Rates of these entries have no value. */
static int not_finite(ordernm_motion *m, const double *rate)
{
    for (int i = 0; i < m->ny + m->nx; ++i)
        if (rate[i]*0.0 != 0.0) m->results->component = i;
    return ORDERNM_NOT_FINITE;
}

/* Results at a state; the reason where there are none. */
static int keep(ordernm_motion *m, double t, const double *z)
{
    const int status = ordernm_report(m, t, z, m->row);
    if (status) return failed(m->results, status);
    keep_row(m->results, m->row, ordernm_row_size(m->problem));
    return ORDERNM_ENDED;
}

/* Results at the times within the step that has been made. Without room for them the step is made again. */
static int sample(ordernm_motion *m, double end)
{
    const ordernm_problem *const p = m->problem;
    const double h = end - m->t;
    while (m->sampled < p->ntimes && p->times[m->sampled] <= end) {
        if (m->results->count == m->results->capacity) return ORDERNM_FULL;
        const double t = p->times[m->sampled];
        const double *z = m->next;
        if (t < end) {
            if (!m->complete) {
                const int status = m->method->complete(m, h);
                if (status) return failed(m->results, status);
                m->complete = 1;
            }
            m->method->interpolate(m, h, (t - m->t)/h, m->trial);
            z = m->trial;
            /* predictions between the ends of a step are as good as at its ends */
        }
        const int reason = keep(m, t, z);
        if (reason != ORDERNM_ENDED) return reason;
        ++m->sampled;
    }
    return ORDERNM_ENDED;
}

/* ---- Events. ---- */

/* Outputs at a state, less the levels of events. Returns what a function returned. */
static int crossings(ordernm_motion *m, double t, const double *z, double *g)
{
    const ordernm_problem *const p = m->problem;
    ordernm_call c = ordernm_arguments(m, t, z);
    int status = ordernm_close_loops(m, &c);
    if (status) return status;
    c.outputs = m->outputs;
    if ((status = m->system->outputs(&c))) return status;
    for (int i = 0; i < p->nevents; ++i) g[i] = m->outputs[p->events[i].output] - p->events[i].level;
    return 0;
}

static int crosses(const ordernm_event *e, double before, double after)
{
    return (e->direction >= 0 && before < 0.0 && after >= 0.0) || (e->direction <= 0 && before > 0.0 && after <= 0.0);
}

/* The first event within the step that was made, as a part of it; 2 if there is none (A. Dekker's bisection and secants on the
 * interpolant, the Illinois way). */
static int locate(ordernm_motion *m, double h, double *first, int *which)
{
    const ordernm_problem *const p = m->problem;
    *first = 2.0;
    for (int e = 0; e < p->nevents; ++e) {
        m->part[e] = 2.0;
        if (!crosses(p->events + e, m->crossing[e], m->after[e])) continue;
        double low = 0.0, high = 1.0, g_low = m->crossing[e], g_high = m->after[e];
        for (int n = 0; n < 60 && high - low > 1e-14; ++n) {
            double at = n > 16 || n%8 == 7 ? 0.5*(low + high) : high - g_high*(high - low)/(g_high - g_low);
            if (!(at > low && at < high)) at = 0.5*(low + high);
            m->method->interpolate(m, h, at, m->trial);
            const int status = crossings(m, m->t + at*h, m->trial, m->within);
            if (status) return status;
            const double g = m->within[e];
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
        if (high < *first) *first = high, *which = e;
    }
    return 0;
}

/* Makes the step again so that it ends where an event happens: its size by secants on what steps of other sizes end at. */
static int step_to_event(ordernm_motion *m, int e, double *h)
{
    const double whole = *h;
    double size = *h, before = 0.0, g_before = m->crossing[e], best = INFINITY, found = *h;
    for (int n = 0; n < 8; ++n) {
        double error;
        int status = m->method->step(m, size, &error);
        if (!status) status = crossings(m, m->t + size, m->next, m->within);
        if (status) return status;
        const double g = m->within[e];
        if (!(fabs(g) < best)) break;
        best = fabs(g);
        found = size;
        if (g == 0.0 || g == g_before) break;
        const double next = size - g*(size - before)/(g - g_before);
        before = size;
        g_before = g;
        if (!(next > 0.0 && next < 2.0*whole) || fabs(next - size) <= 2e-16*size) break;
        size = next;
    }
    double error;
    const int status = m->method->step(m, found, &error);
    *h = found;
    return status;
}

/* Looks for events in the step that was made; if there is one, the step ends there. `which` is it, or -1. */
static int look_for_events(ordernm_motion *m, double *h, int *which)
{
    const ordernm_problem *const p = m->problem;
    *which = -1;
    int status = crossings(m, m->t + *h, m->next, m->after);
    if (status) return status;
    int any = 0;
    for (int e = 0; e < p->nevents; ++e) any |= crosses(p->events + e, m->crossing[e], m->after[e]);
    if (!any) return 0;
    double part;
    if ((status = m->method->complete(m, *h))) return status;
    if ((status = locate(m, *h, &part, which))) return status;
    const double made = part**h;
    *h = made;
    if ((status = step_to_event(m, *which, h))) return status;
    if ((status = ordernm_rates(m, m->t + *h, m->next, m->rate[m->method->stages]))) return status;
    if ((status = crossings(m, m->t + *h, m->next, m->after))) return status;
    /* it is behind now, on whichever side rounding has left it, and so are others that happened at the same time; those that
     * have happened just before stay behind */
    for (int e = 0; e < p->nevents; ++e) {
        if (m->part[e] <= part + 1e-13 || (m->after[e] == 0.0 && crosses(p->events + e, m->crossing[e], m->after[e])))
            m->after[e] = m->crossing[e] < 0.0 ? BEHIND : -BEHIND;
        else if (fabs(m->crossing[e]) == BEHIND && part < 1e-9)
            m->after[e] = m->crossing[e];
    }
    return 0;
}

static int keep_event(ordernm_motion *m, double t, int which)
{
    ordernm_results *const r = m->results;
    if (!r->events) return ORDERNM_ENDED;
    const long size = ordernm_row_size(m->problem);
    const int status = ordernm_report(m, t, m->next, r->events + r->events_count*size);
    if (status) return failed(r, status);
    r->which[r->events_count++] = which;
    return ORDERNM_ENDED;
}

static void keep_step(const ordernm_motion *m, double h)
{
    ordernm_results *const r = m->results;
    double *const at = r->steps + r->steps_count*ordernm_step_size(m->problem);
    at[0] = m->t;
    at[1] = h;
    memcpy(at + 2, m->z, (m->ny + m->nx + m->nd)*sizeof(double));
    ++r->steps_count;
}

static int begin(ordernm_motion *m)
{
    const ordernm_problem *const p = m->problem;
    ordernm_find_segment(m, m->t, 1e-12*(1.0 + fabs(m->t)));
    if (ordernm_settle(m, m->t, m->z) < 0) return failed(m->results, -1);
    const int status = ordernm_rates(m, m->t, m->z, m->rate[0]);
    if (status) return failed(m->results, status);
    if (!ordernm_all_finite(m->rate[0], m->size)) return not_finite(m, m->rate[0]);
    const int unknown = p->nevents ? crossings(m, m->t, m->z, m->crossing) : 0;
    if (unknown) return failed(m->results, unknown);
    if (!p->ntimes || p->times[0] <= p->start) {
        const int reason = keep(m, m->t, m->z);
        if (reason != ORDERNM_ENDED) return reason;
        m->sampled = p->ntimes ? 1 : 0;
    }
    m->h = p->step;
    if (m->h <= 0.0) {
        const double limit = fmin(p->end - p->start, p->largest_step > 0.0 ? p->largest_step : INFINITY);
        const int failure = first_step(m, limit, &m->h);
        if (failure) m->h = 1e-6*limit; /* the step that is tried will tell */
    }
    m->begun = 1;
    return ORDERNM_ENDED;
}

int ordernm_go(ordernm_motion *m, ordernm_results *r, double seconds)
{
    const ordernm_problem *const p = m->problem;
    const ordernm_system *const s = m->system;
    const method *const method = m->method;
    const int adaptive = p->method != ORDERNM_RK4;
    const double deadline = seconds > 0.0 ? seconds_now() + seconds : INFINITY;
    m->results = r;
    r->t = m->t;
    if (!m->begun) {
        if (r->capacity < 1) return ORDERNM_FULL;
        const int reason = begin(m);
        if (reason != ORDERNM_ENDED) return reason;
    }
    for (long n = 1; m->t < p->end; ++n) {
        if (!p->ntimes && r->count == r->capacity) return ORDERNM_FULL;
        if (r->steps && r->steps_count == r->steps_capacity) return ORDERNM_FULL;
        if (r->events && r->events_count + p->nevents > r->events_capacity) return ORDERNM_FULL;
        if (p->most_steps && r->accepted + r->rejected >= p->most_steps) return ORDERNM_MANY_STEPS;
        if (n%CLOCK_STEPS == 0 && seconds_now() > deadline) return ORDERNM_PAUSED;
        /* how far: not beyond the end, nor a knot of the inputs; what is left over is not tiny */
        const double knot = ordernm_next_knot(m, m->t), wall = knot < p->end ? knot : p->end;
        double h = p->largest_step > 0.0 && m->h > p->largest_step ? p->largest_step : m->h;
        const double left = wall - m->t;
        int to_wall = h >= left*(1.0 - 1e-9) || left - h <= 1e-15*fabs(wall);
        if (to_wall) h = left;
        else if (adaptive && 2.0*h > left) h = 0.5*left;
        if (h <= 4e-16*fabs(m->t) || !(h > 0.0)) return ORDERNM_COLLAPSED;
        ordernm_find_segment(m, m->t, h);
        double error = 0.0;
        int status = method->step(m, h, &error);
        double end = to_wall ? wall : m->t + h;
        if (!status && error <= 1.0) status = ordernm_rates(m, end, m->next, m->rate[method->stages]);
        if (!status && error <= 1.0 && m->nd && adaptive && ordernm_jumped(m, m->next)) status = -1;
        if (!status && !ordernm_all_finite(m->rate[method->stages], m->values)) error = NAN;
        int event = -1;
        if (p->nevents && !status && error <= 1.0) {
            const double whole = h;
            status = look_for_events(m, &h, &event);
            if (event >= 0) {
                to_wall = 0;
                end = m->t + h;
                if (fabs(wall - end) <= 1e-15*fabs(wall)) end = wall;
                m->h = whole; /* the step behind it is like the one that it has cut */
            }
        }
        if (m->imprecise && !s->precise_closing_step && !r->as_is) {
            m->imprecise = 0;
            return ORDERNM_IMPRECISE;
        }
        if (status || !(error <= 1.0)) {
            if (!adaptive) return status ? failed(r, status) : not_finite(m, m->rate[method->stages]);
            ++r->rejected;
            r->component = worst_entry(m);
            double change = AFTER_FAILURE;
            if (!status && error == error) change = fmax(LEAST_CHANGE, SAFETY*pow(error, -1.0/method->order));
            m->h = h*change;
            m->rejected_before = 1;
            if (m->h <= 1e-15*fmax(fabs(m->t), fabs(p->end - p->start))) return status ? failed(r, status) : ORDERNM_COLLAPSED;
            continue;
        }
        m->complete = 0;
        if (p->ntimes) {
            const int reason = sample(m, end);
            if (reason != ORDERNM_ENDED) return reason;
        }
        ++r->accepted;
        if (r->steps) keep_step(m, h);
        int stop = 0;
        for (int e = 0; event >= 0 && e < p->nevents; ++e) {
            if (!crosses(p->events + e, m->crossing[e], m->after[e])) continue; /* others may happen at the same time */
            const int reason = keep_event(m, end, e);
            if (reason != ORDERNM_ENDED) return reason;
            stop |= p->events[e].stop;
        }
        double change = error > 0.0 ? SAFETY*pow(error, -1.0/method->order) : LARGEST_CHANGE;
        change = fmin(fmax(change, LEAST_CHANGE), m->rejected_before ? 1.0 : LARGEST_CHANGE);
        m->rejected_before = 0;
        if (adaptive && event < 0 && !(to_wall && change*h < m->h)) m->h = h*change;
        m->t = r->t = end;
        if (p->nevents) {
            double *const passed = m->crossing;
            m->crossing = m->after;
            m->after = passed;
        }
        double *const before = m->z;
        m->z = m->next;
        m->next = before;
        double *const last = m->rate[method->stages];
        m->rate[method->stages] = m->rate[0];
        m->rate[0] = last;
        const int changed = ordernm_settle(m, m->t, m->z);
        if (changed < 0) return failed(r, changed);
        if (changed || ordernm_next_knot(m, m->t) != knot) {
            ordernm_find_segment(m, m->t, 1e-9*(1.0 + fabs(m->t)));
            const int failure = ordernm_rates(m, m->t, m->z, m->rate[0]);
            if (failure) return failed(r, failure);
        }
        if (!p->ntimes) {
            const int reason = keep(m, m->t, m->z);
            if (reason != ORDERNM_ENDED) return reason;
        }
        if (stop) return ORDERNM_EVENT;
        r->next_step = m->h;
        if (p->poor > 0.0 && r->condition_here > p->poor && m->t < p->end) return ORDERNM_POOR;
    }
    r->t = m->t;
    return ORDERNM_ENDED;
}
