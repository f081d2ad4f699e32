/* A motion from its beginning to its end: memory, the size of steps, what happens between them. */
#include "inside.h"

#include <math.h>
#include <string.h>
#include <time.h>

enum { CLOCK_STEPS = 16 };    /* the clock is read once in so many steps */

/* A motion that comes no farther than such a part of its time in so many steps will not end. */
enum { STUCK_STEPS = 2000 };
static const double STUCK = 1e-9;

/* A motion that passes this number of switches in such a time has an accumulation of them. */
enum { MOST_PASSED = 100 };

/* Of DOP853. Steps at the limit that are too many, and steps away from it after which they are forgotten. */
static const double LIMIT_OF_STABILITY = 6.1;
enum { FAR_STEPS = 15, NEAR_STEPS = 6 };

/* Conditions below it are not poor, whatever is asked for. */
static const double LEAST_POOR = 10.0;

/* Where derivatives are wanted, forward or on the way back. Near a pose rounding changes them by its size times condition^3, times
 * some tens or hundreds, and both ways are to agree to rounding. A condition that is poor all the time comes of a mechanism's
 * proportions and does no such harm, so what is poor is as many times the best that has been met, by how long steps are: of the
 * method of order 8, of others; or this one in any case. And what no stage should have. */
static const double WORSE_IN_LONG_STEPS = 2.5, WORSE = 6.0, POOR_IN_ANY_CASE = 30.0, TOO_POOR_FOR_DERIVATIVES = 50.0;

static const double LEAST_HOPELESS = 1e3, LEAST_TOO_POOR = 1e4; /* the latter of constant steps */

/* At conditions that are larger by this, other independents are looked at again. */
static const double LOOK_AGAIN = 3.0;

/* So often a step is made again because a stage is too near to a pose where a loop loses rank. */
enum { MOST_MOVES = 3 };
static const double AT_POSE = 0.005; /* in parts of the step: no stage but the last is as near */
static const double LEAST_MOVE = 0.02; /* in parts of the step: less makes no difference */

/* Steps before a dead point end short of it by a tenth of the way, and from such a condition on there are no more; so often one is
 * made again. */
static const double SHORT = 0.9, NEAR_ENOUGH = 100.0;
enum { MOST_REFUSED = 8 };

static const double SAFETY = 0.9, LEAST_CHANGE = 0.333, LARGEST_CHANGE = 6.0, AFTER_FAILURE = 0.25;

/* How much of a step's size follows from the error of the step before: with it, and SAFETY, a third as many steps are made in vain
 * as without, and an error takes 7 % fewer evaluations (K. Gustafsson; Hairer, Wanner, Solving ODE II, IV.2). */
static const double MEMORY = 0.04, LEAST_REMEMBERED = 1e-4;

/* ---- Memory. ---- */

static long whole_lines(long n) { return (n + 7)/8*8; }

static const method *method_of(const ordernm_problem *p)
{
    const ordernm_system *s = p->system;
    const int solves = s->nfree_q + s->nfree_u > 0; /* else an implicit method has no equations */
    return p->method == ORDERNM_RK4 ? &ordernm_rk4 : p->method == ORDERNM_RADAU && solves ? &ordernm_radau : &ordernm_dop853;
}

/* Of long doubles: the workspace, and what NAME_precise.c has beside it. */
static long precise_numbers(const ordernm_system *s)
{
    const long values = 3L*s->nq + 3L*s->nu + s->np + s->ninputs + s->noutputs + s->nclosure + s->nloops;
    return s->workspace + values + LANES*(3L*s->nq + 3L*s->nu + s->np + s->ninputs + s->noutputs + 1);
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
    m->adaptive = p->method != ORDERNM_RK4 && !p->fixed;
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
        const int four = left <= LANES/2 && m->method->rows && s->state_rate_sensitivities[ORDERNM_FOUR];
        const int width = left == 1 ? 1 : four ? LANES/2 : LANES;
        const int index = left == 1 ? ORDERNM_ONE : four ? ORDERNM_FOUR : ORDERNM_EIGHT;
        group g = {width, index, n*LANES, left < LANES ? left : LANES, m->size, ordernm_numbers(&of, s->np*width)};
        m->size += whole_lines((long)(m->ny + m->nx)*width);
        if (at) m->groups[n] = g;
    }
    m->dependent = ordernm_take(&of, (m->nd + 1)*sizeof(int));
    m->turned = ordernm_take(&of, (s->nquaternions + 1)*sizeof(int));
    m->lengths = ordernm_numbers(&of, s->nquaternions);
    for (int i = 0; i < m->method->all; ++i) m->rate[i] = ordernm_numbers(&of, m->size);
    double **states[] = {&m->z, &m->next, &m->trial, &m->zeros, m->error, m->error + 1, &m->at_pose};
    for (size_t i = 0; i < sizeof states/sizeof *states; ++i) *states[i] = ordernm_numbers(&of, m->size);
    for (int i = 0; i < 5; ++i) m->probe[i] = ordernm_numbers(&of, m->nd ? m->values : 0);
    m->work = ordernm_numbers(&of, s->workspace);
    if (s->closing_step)
        m->precise_work = ordernm_take(&of, precise_numbers(s)*sizeof(long double));
    double **of_q[] = {&m->q, &m->qdot, &m->newton, &m->closed}, **of_u[] = {&m->u, &m->udot};
    double **lanes_q[] = {&m->dq, &m->dqdot, &m->full_dq}, **lanes_u[] = {&m->du, &m->dudot, &m->full_du};
    const long wider = s->nq > s->nu ? s->nq : s->nu; /* qdot is the place of speeds too */
    for (int i = 0; i < 4; ++i) *of_q[i] = ordernm_numbers(&of, wider);
    for (int i = 0; i < 2; ++i) *of_u[i] = ordernm_numbers(&of, s->nu);
    for (int i = 0; i < 3; ++i) *lanes_q[i] = ordernm_numbers(&of, s->nq*LANES), *lanes_u[i] = ordernm_numbers(&of, s->nu*LANES);
    m->position = ordernm_numbers(&of, s->nclosure);
    const long loops = m->identity ? 0 : s->nloops;
    m->ranks = ordernm_numbers(&of, MOST_STAGES*loops), m->ranks_between = ordernm_numbers(&of, RANKS_BETWEEN*loops);
    m->condition = ordernm_numbers(&of, s->nloops);
    m->flat = ordernm_numbers(&of, 1 + 2L*s->nq);
    m->outputs = ordernm_numbers(&of, s->noutputs);
    m->doutputs = ordernm_numbers(&of, s->noutputs*LANES);
    m->inputs = ordernm_numbers(&of, s->ninputs);
    m->dinputs = ordernm_numbers(&of, s->ninputs*LANES);
    m->dt = ordernm_numbers(&of, LANES);
    const int switching = s->switches != 0;
    m->held = ordernm_take(&of, (s->nswitches + 1)*sizeof(int));
    if (at) ordernm_hold_switches(m);
    double **of_switches[] = {&m->modes, &m->switches, &m->crossed, &m->changed, &m->let_go, &m->speeds, &m->modes_before,
        &m->switches_kept};
    for (int i = 0; i < 8; ++i) *of_switches[i] = ordernm_numbers(&of, s->nswitches);
    m->together = ordernm_take(&of, (s->nswitches + 1)*sizeof(int));
    m->z_before = ordernm_numbers(&of, switching ? m->size : 0);
    m->lost = ordernm_numbers(&of, (long)m->ngroups*LANES);
    m->dswitches = ordernm_numbers(&of, (long)s->nswitches*LANES);
    m->switch_along = ordernm_numbers(&of, switching ? (long)m->ngroups*LANES : 0);
    m->switch_time = ordernm_numbers(&of, switching ? (long)m->ngroups*LANES : 0);
    m->passing_time = ordernm_numbers(&of, switching ? (long)m->ngroups*LANES : 0);
    m->input_rates = ordernm_numbers(&of, s->ninputs);
    m->no_dp = ordernm_numbers(&of, s->np);
    m->head = ordernm_head_size(p);
    m->nwatched = p->nevents + m->nheld;
    const int most_watched = p->nevents + s->nswitches;
    const long described = ordernm_event_size(p);
    double **rows[] = {&m->row, &m->known_row};
    for (int i = 0; i < 2; ++i) *rows[i] = ordernm_numbers(&of, described);
    m->beside = ordernm_numbers(&of, m->identity ? 0 : BESIDE*described);
    m->stages = ordernm_numbers(&of, ordernm_step_size(p));
    double **of_events[] = {&m->crossing, &m->after, &m->within, &m->part, &m->happened, &m->paces, &m->at_first};
    for (int i = 0; i < 7; ++i) *of_events[i] = ordernm_numbers(&of, most_watched);
    m->samples = ordernm_numbers(&of, (long)EVENT_SAMPLES*most_watched);
    if (m->method == &ordernm_radau) {
        void *own = ordernm_take(&of, ordernm_radau_layout(m, 0));
        if (own) ordernm_radau_layout(m, own);
    }
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
    const method *const method = method_of(p);
    const long state = s->nq + s->nfree_u + p->nintegrals;
    /* with the stages that are not its beginning; explicit ones with coordinates for which loops are closed, and the first rate */
    const long stages = method->rows ? (method->stages - 1)*(state + (s->closing_step ? s->nq : 0)) + state : method->stages*state;
    return ordernm_head_size(p) + state + stages;
}

long ordernm_head_size(const ordernm_problem *p) { return ORDERNM_STEP_HEAD + 2*p->system->nswitches; }

long ordernm_known_size(const ordernm_problem *p)
{
    const ordernm_system *s = p->system;
    return method_of(p) == &ordernm_radau ? 4 + 4*whole_lines(s->nq + s->nfree_u + p->nintegrals) : 0;
}

static int finite_along(const double *S, int n, int width, int lane)
{
    double sum = 0.0;
    for (int i = 0; i < n; ++i) sum += 0.0*S[i*width + lane];
    return sum == 0.0;
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
    for (int i = 0; i < m->nd; ++i)
        for (int k = 0; k < s->nquaternions; ++k) m->turned[k] |= m->dependent[i] == s->quaternion[k];
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
            if (finite_along(S, s->nfree_q + s->nfree_u, g->width, l)) continue;
            m->lost[n*LANES + l] = NAN; /* lost in a motion before this one */
            for (int i = 0; i < s->nfree_q + s->nfree_u; ++i) S[i*g->width + l] = 0.0;
        }
    }
    m->t = p->start;
    /* rounding of conditions moves dependents in proportion to the condition, and rates to its square */
    const double rounding = fmax(1.0, s->nloops);
    m->poor = m->poor_rates = fmax(sqrt(0.01*p->rtol/(2.2e-16*rounding)), LEAST_POOR);
    /* in long double, where coordinates keep what is rounded, to its cube; predictions tell branches apart that differ by more */
    const double by_rounding = fmax(m->poor, cbrt(0.01*p->rtol/(5.4e-20*rounding)));
    m->too_poor = m->adaptive ? fmax(fmin(by_rounding, 0.03/p->rtol), LEAST_POOR) : fmax(by_rounding, LEAST_TOO_POOR);
    /* constants are doubles: lengths that ought to be the same are off by so much where they were turned */
    m->telling = fmax(cbrt(0.01*p->rtol/(2.2e-16*rounding)), LEAST_POOR);
    /* speeds are off by rounding times the condition, and in long double by its square */
    m->hopeless = fmax(fmin(0.1*p->rtol/2.2e-16, sqrt(0.1*p->rtol/(5.4e-20*rounding))), LEAST_HOPELESS);
    m->pose = m->refused_pose = -INFINITY;
    m->mark = p->start;
    m->looked_at = p->looked_at;
    return m;
}

/* From here on derivatives are taken, of this motion or of steps that it keeps; `best` is the least condition at the beginning of
 * the steps so far. */
void ordernm_take_derivatives(ordernm_motion *m, double best)
{
    const double worse = m->method == &ordernm_dop853 ? WORSE_IN_LONG_STEPS : WORSE;
    m->best = best;
    m->derived = 1;
    m->poor_rates = fmin(m->poor, fmin(worse*best, POOR_IN_ANY_CASE));
    m->too_poor = fmin(m->too_poor, TOO_POOR_FOR_DERIVATIVES);
}

/* What is known of conditions where a step begins. */
static void note_best(ordernm_motion *m)
{
    const double best = fmin(m->best, m->conditions[0]);
    if (m->derived && best < m->best) ordernm_take_derivatives(m, best);
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

/* How many entries of the state have errors that count: those that are integrated; where nothing is independent, predictions too,
 * by which dependent coordinates are followed. */
static int counted(const ordernm_motion *m)
{
    return m->ny + m->nx + (m->ny ? 0 : m->nd);
}

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
    const long n = m->ny + m->nx, all = counted(m);
    const double state = mean_square(all, 1, error, m->z, next, p->atol, 0, p->rtol);
    const double other = mean_square(all, 1, second, m->z, next, p->atol, 0, p->rtol);
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
    for (int i = 0; i < counted(m); ++i) {
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
    const int n = counted(m);
    double size = 0.0, rate = 0.0, bend = 0.0;
    *h = limit;
    if (!n) return 0;
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
    if (status == SLIDES) return ORDERNM_SLIDING;
    r->singular = status;
    return status < 0 ? ORDERNM_OPEN : ORDERNM_SINGULAR;
}

/* Rates of these entries have no value. */
static int not_finite(ordernm_motion *m, const double *rate)
{
    for (int i = 0; i < counted(m); ++i)
        if (rate[i]*0.0 != 0.0) m->results->component = i;
    return ORDERNM_NOT_FINITE;
}

/* Whether something was to be computed in long double that has not been compiled yet; it is once. */
static int wants_precise(ordernm_motion *m)
{
    const int wanted = m->imprecise && !m->system->precise && !m->results->as_is;
    m->imprecise = 0;
    return wanted;
}

/* Results at a state; the reason where there are none. Those at a pose that a step ends at are known. */
static int keep(ordernm_motion *m, double t, const double *z)
{
    const int known = m->row_known && m->known_row[0] == t;
    const int status = known ? 0 : ordernm_report(m, t, z, m->row);
    if (wants_precise(m)) return ORDERNM_IMPRECISE;
    if (status) return failed(m->results, status);
    keep_row(m->results, known ? m->known_row : m->row, ordernm_row_size(m->problem));
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
        int reason = keep(m, t, z);
        if (reason == ORDERNM_IMPRECISE) return reason;
        if (m->nd && t < end && (reason != ORDERNM_ENDED || m->results->condition_here > m->hopeless)
            && !ordernm_beside_within(m, h, (t - m->t)/h, ordernm_row_size(p))) {
            if (reason == ORDERNM_ENDED) --m->results->count;
            keep_row(m->results, m->known_row, ordernm_row_size(p));
            reason = ORDERNM_ENDED;
        }
        if (reason != ORDERNM_ENDED) return reason;
        ++m->sampled;
    }
    return ORDERNM_ENDED;
}

static void keep_step(const ordernm_motion *m, double h)
{
    ordernm_results *const r = m->results;
    double *const row = r->steps + r->steps_count*ordernm_step_size(m->problem);
    row[0] = m->t;
    row[1] = h;
    row[4] = m->best;
    ordernm_keep_modes(m, row + ORDERNM_STEP_HEAD);
    memcpy(row + m->head, m->z, (m->ny + m->nx + m->nd)*sizeof(double));
    m->method->keep(m, row);
    ++r->steps_count;
}

static int begin(ordernm_motion *m)
{
    const ordernm_problem *const p = m->problem;
    ordernm_find_segment(m, m->t, 1e-12*(1.0 + fabs(m->t)));
    if (ordernm_settle(m, m->t, m->z) < 0) return failed(m->results, -1);
    ordernm_note_condition(m, 0, 0);
    note_best(m);
    int status = m->nheld ? ordernm_choose_modes(m, m->t, m->z) : 0;
    if (!status) status = ordernm_rates(m, m->t, m->z, m->rate[0]);
    ordernm_note_precise(m, 0);
    if (wants_precise(m)) return ORDERNM_IMPRECISE;
    if (status) return failed(m->results, status);
    if (!ordernm_all_finite(m->rate[0], m->size)) return not_finite(m, m->rate[0]);
    ordernm_note_condition(m, 0, 0);
    int unknown = p->nevents ? ordernm_crossings(m, m->t, m->z, m->crossing) : 0;
    if (!unknown && m->nheld) unknown = ordernm_sides(m, m->t, m->z, m->crossing + p->nevents);
    if (!unknown && m->nheld) unknown = ordernm_limit_turns(m);
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

/* Whether the limit of stability keeps an explicit method's steps small (E. Hairer, S. P. Norsett and G. Wanner, DOP853): where
 * its last two stages, both at the step's end, differ, their rates differ by the largest eigenvalue. */
static void watch_stability(ordernm_motion *m, double h)
{
    const double *const last = m->rate[m->method->stages - 1], *const end = m->rate[m->method->stages];
    double rates = 0.0, states = 0.0;
    for (int i = 0; i < m->ny; ++i) {
        const double rate = end[i] - last[i], state = m->next[i] - m->trial[i];
        rates += rate*rate;
        states += state*state;
    }
    const double product = states > 0.0 ? h*sqrt(rates/states) : 0.0;
    if (product > LIMIT_OF_STABILITY) {
        m->near_steps = 0;
        if (++m->far_steps >= FAR_STEPS && product > m->results->stiffness) m->results->stiffness = product;
    } else if (++m->near_steps >= NEAR_STEPS) {
        m->far_steps = 0;
    }
}

/* ---- One step after the other. ---- */

/* How far a step goes: not beyond the end, nor a knot of the inputs; what is left over is not tiny. */
static int plan(ordernm_motion *m, trial *step)
{
    const ordernm_problem *const p = m->problem;
    step->knot = ordernm_next_knot(m, m->t);
    step->wall = step->knot < p->end ? step->knot : p->end;
    step->h = p->largest_step > 0.0 && m->h > p->largest_step ? p->largest_step : m->h;
    if (m->shorter > 0.0 && step->h > m->shorter) step->h = m->shorter;
    if (m->turning > 0.0 && step->h > m->turning) step->h = m->turning;
    const double left = step->wall - m->t, wanted = step->h;
    if (m->nd && m->method->gap > 0.0) step->h = ordernm_step_at_pose(m, step->h, step->wall);
    step->to_pose = step->h != wanted;
    step->again = 0;
    /* steps of one size add up to an end with rounding */
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

/* A motion that ends where a loop has lost rank: what is there is found beside. Returns whether it is. */
static int end_at_pose(ordernm_motion *m, trial *step)
{
    if (m->results->steps) return 0; /* it is not a step's end, and the adjoint would not know */
    if (!step->to_wall || step->end != m->problem->end) return 0;
    const int last = m->method->gives_rate ? m->method->stages - 1 : m->method->stages; /* at the end */
    if (!(fabs(m->pose - step->end) <= AT_POSE*step->h || m->conditions[last] > m->hopeless)) return 0;
    step->at_pose = !ordernm_beside(m, step->h, ordernm_report, ordernm_row_size(m->problem));
    if (step->at_pose) {
        step->error = 0.0;
        return 1;
    }
    m->row_known = 0; /* steps of other sizes stand where this one was */
    const method *const method = m->method;
    const int status = method->step(m, step->h, &step->error);
    if (!status && step->error <= 1.0 && !method->gives_rate) ordernm_rates_at_end(m, step->end, m->rate[method->stages]);
    return 0;
}

/* Whether a dropped condition is open by more than it may be at the end of the step that was made. */
static int comes_apart(ordernm_motion *m, const trial *step)
{
    if (!m->system->ndropped) return 0;
    if (m->method->gives_rate) { /* its loops have not been closed yet */
        const double condition = m->results->condition_here;
        ordernm_call c;
        ordernm_arguments(m, step->end, m->next, &c);
        if (ordernm_close_loops(m, &c)) return 0;
        m->results->condition_here = condition;
        m->apart_at_end = m->apart;
    }
    return !(m->apart_at_end <= m->system->apart);
}

/* Tries a step. Returns what a function returned, -1 where loops do not close or close on another branch. */
static int attempt(ordernm_motion *m, trial *step)
{
    const ordernm_problem *const p = m->problem;
    const method *const method = m->method;
    double *const rate = m->rate[method->stages];
    m->advice = 0.0;
    m->row_known = m->complete = m->closed_known = 0;
    for (int i = 1; i < MOST_STAGES; ++i) m->conditions[i] = 0.0;
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
        const double elsewhere = ordernm_step_at_pose(m, step->h, step->wall);
        /* what the end of an implicit step is like its last stage says */
        const int moves = method->gives_rate ? good || status : too_near;
        step->again = moves && m->moved < MOST_MOVES && fabs(elsewhere - step->h) > LEAST_MOVE*step->h;
    }
    if (status || step->again || !good) return status;
    if (m->nd && m->adaptive && ordernm_jumped(m, m->next)) return -1;
    if (!ordernm_all_finite(rate, m->values)) step->error = NAN;
    if (!(step->error <= 1.0)) return 0;
    if (m->nd && (step->dead = ordernm_dead_point_within(m, step->h)) > 0.0) return 0;
    if ((step->apart = comes_apart(m, step))) return 0;
    if (!m->nwatched) return 0;
    const double whole = step->h;
    status = ordernm_look_for_events(m, step);
    if (step->event < 0 || status) return status;
    step->to_wall = 0;
    step->end = m->t + step->h;
    if (fabs(step->wall - step->end) <= 1e-15*fabs(step->wall)) step->end = step->wall;
    m->h = whole; /* the step behind it is like the one that it has cut */
    return status;
}

/* Parts of a motion's time that steps become as small as before a dropped condition opens by too much. */
static const double BEFORE_APART = 1e-5;

/* Such a step is made again, shorter; the reason if that is small already. */
static int end_together(ordernm_motion *m, const trial *step)
{
    ++m->results->rejected;
    m->results->component = m->widest;
    if (!m->adaptive || step->h < BEFORE_APART*(m->problem->end - m->problem->start)) return ORDERNM_APART;
    m->h = 0.5*step->h;
    m->rejected_before = 1;
    return ORDERNM_ENDED;
}

/* A step over a dead point is made again so that it ends before it, where other independents may be taken; the reason if it is as
 * near as steps should come. */
static int end_short(ordernm_motion *m, const trial *step)
{
    ++m->results->rejected;
    if (m->conditions[0] > NEAR_ENOUGH || ++m->refused > MOST_REFUSED) return ORDERNM_UNDETERMINED;
    m->shorter = SHORT*step->dead*step->h;
    if (m->adaptive) m->h = m->shorter;
    m->rejected_before = 1;
    return ORDERNM_ENDED;
}

/* Steps of one size do not become smaller where conditions are poor: other independents are looked at before such a step. */
static int passes_poor_poses(ordernm_motion *m)
{
    const ordernm_problem *const p = m->problem;
    double worst = 0.0;
    if (!(p->poor > 0.0)) return 0;
    for (int i = 1; i <= m->method->stages; ++i) worst = fmax(worst, m->conditions[i]);
    if (!(worst > fmax(p->poor, LOOK_AGAIN*m->looked_at))) return 0;
    m->results->condition_here = worst;
    return 1;
}

/* After a step that failed, or whose error is too large: the size of the next one; the reason if there is none. */
static int refuse(ordernm_motion *m, const trial *step, int status)
{
    const ordernm_problem *const p = m->problem;
    ordernm_results *const r = m->results;
    const method *const method = m->method;
    if (m->nheld && (status || step->error != step->error) && ordernm_let_go(m)) {
        ++r->rejected;
        return ORDERNM_ENDED; /* the same step again, every switch in the branch that the state is in */
    }
    if (!m->adaptive) {
        if (status) return failed(r, status);
        return method->gives_rate ? ORDERNM_COLLAPSED : not_finite(m, m->rate[method->stages]);
    }
    ++r->rejected;
    r->component = worst_entry(m);
    double change = AFTER_FAILURE;
    if (!status && step->error == step->error) change = fmax(LEAST_CHANGE, SAFETY*pow(step->error, -1.0/method->order));
    /* advice that is not to refuse the step is of a method that has not seen why it is refused */
    m->h = step->h*(m->advice > 0.0 && m->advice < 1.0 ? m->advice : change);
    m->rejected_before = 1;
    if (!status && m->pose > m->t && m->pose < step->end) {
        m->refused_pose = m->pose;
        m->refused_step = step->h;
        m->refused_error = step->error;
    }
    if (m->h > 1e-15*fmax(fabs(m->t), fabs(p->end - p->start))) return ORDERNM_ENDED;
    return status ? failed(r, status) : ORDERNM_COLLAPSED;
}

/* The next step's size. */
static void resize(ordernm_motion *m, const trial *step)
{
    const double before = m->error_before > 0.0 ? m->error_before : LEAST_REMEMBERED;
    double change = LARGEST_CHANGE;
    if (step->error > 0.0) change = SAFETY*pow(step->error, 0.75*MEMORY - 1.0/m->method->order)*pow(before, MEMORY);
    m->error_before = fmax(step->error, LEAST_REMEMBERED);
    change = m->advice > 0.0 ? m->advice : fmax(change, LEAST_CHANGE);
    change = fmin(change, m->rejected_before ? 1.0 : LARGEST_CHANGE);
    m->rejected_before = 0;
    const int shorter = step->to_wall || step->to_pose;
    if (m->adaptive && step->event < 0 && !(shorter && change*step->h < m->h)) m->h = step->h*change;
}

static void exchange(double **one, double **other)
{
    double *const kept = *one;
    *one = *other;
    *other = kept;
}

/* The end of a step, before which the next knot of the inputs was that one, becomes the beginning of the next step; a state
 * at a pose is settled. Steps that are made again go this way too, for rounding to be the same. */
int ordernm_next_step(ordernm_motion *m, double end, double knot, int settled, const double *modes)
{
    int status;
    m->t = end;
    exchange(&m->z, &m->next);
    exchange(&m->rate[0], &m->rate[m->method->stages]);
    m->precise = m->precise_at_end;
    ordernm_note_precise(m, 0);
    const int changed = settled ? 0 : ordernm_settle(m, m->t, m->z);
    if (changed < 0) return changed;
    ordernm_note_condition(m, 0, 0);
    note_best(m);
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
    if (!changed && !at_knot && !m->switched) return 0;
    ordernm_find_segment(m, m->t, 1e-9*(1.0 + fabs(m->t)));
    if (m->nheld && at_knot && !modes && (status = ordernm_follow_inputs(m))) return status;
    status = ordernm_rates(m, m->t, m->z, m->rate[0]);
    ordernm_note_precise(m, 0);
    return status;
}

static int go_on(ordernm_motion *m, const trial *step, int *stop)
{
    ordernm_results *const r = m->results;
    r->t = step->end;
    const ordernm_problem *const p = m->problem;
    exchange(&m->crossing, &m->after);
    for (int i = 0; i < m->nheld; ++i)
        m->crossed[m->held[i]] = step->event >= 0 && m->happened[p->nevents + i] > 0.0 ? fmax(m->paces[p->nevents + i], 1e-300) : 0.0;
    int failure = ordernm_next_step(m, step->end, step->knot, step->at_pose, 0);
    const int at_knot = ordernm_next_knot(m, m->t) != step->knot;
    if (!failure && m->nheld && (m->switched || at_knot)) failure = ordernm_sides(m, m->t, m->z, m->crossing + p->nevents);
    if (!failure && p->nevents && m->switched) failure = ordernm_compare_events(m);
    if (!failure && p->nevents && (m->switched || at_knot)) failure = ordernm_jumped_events(m, !at_knot, stop);
    if (!failure && m->nheld) failure = ordernm_limit_turns(m);
    if (failure == SLIDES && !p->ntimes) keep(m, m->t, m->z);
    if (failure) return failed(r, failure);
    r->next_step = m->h;
    return m->problem->ntimes ? ORDERNM_ENDED : keep(m, m->t, m->z);
}

/* What is done with a step that is good. */
static int accept(ordernm_motion *m, const trial *step)
{
    const ordernm_problem *const p = m->problem;
    ordernm_results *const r = m->results;
    int stop, reason;
    m->moved = m->refused = m->not_held = 0;
    m->shorter = 0.0;
    if (p->method == ORDERNM_DOP853 && step->event < 0) watch_stability(m, step->h); /* while the last stage is there */
    if (p->ntimes && (reason = sample(m, step->end)) != ORDERNM_ENDED) return reason;
    ++r->accepted;
    if (m->flat[0] > m->t && m->flat[0] <= step->end && r->flat_count < r->flat_capacity)
        memcpy(r->flat + r->flat_count++*(1 + 2L*m->system->nq), m->flat, (1 + 2L*m->system->nq)*sizeof(double));
    if (r->steps) keep_step(m, step->h);
    const int unknown = ordernm_keep_events(m, step, &stop);
    if (unknown) return failed(r, unknown);
    resize(m, step);
    if ((reason = go_on(m, step, &stop)) != ORDERNM_ENDED) return reason;
    if (stop) {
        if (r->steps) keep_step(m, 0.0); /* for what is weighed behind a jump there */
        return ORDERNM_EVENT;
    }
    if (m->switched) return ORDERNM_ENDED; /* the step behind it says what has changed */
    if (r->condition_here <= p->poor) m->looked_at = 0.0;
    const int poor = p->poor > 0.0 && r->condition_here > fmax(p->poor, LOOK_AGAIN*m->looked_at);
    if (poor && m->t < p->end) return ORDERNM_POOR;
    return m->nd && r->condition_here > m->poor && ordernm_undetermined(m) ? ORDERNM_UNDETERMINED : ORDERNM_ENDED;
}

/* Whether results have room for what one step may give. */
static int is_full(const ordernm_motion *m)
{
    const ordernm_problem *const p = m->problem;
    const ordernm_results *const r = m->results;
    return (!p->ntimes && r->count == r->capacity) || (r->steps && r->steps_count + 2 > r->steps_capacity)
           || (r->events && r->events_count + 2*p->nevents > r->events_capacity);
}

/* Whether steps have become so small that the motion stands still. */
static int is_stuck(ordernm_motion *m)
{
    ordernm_results *const r = m->results;
    const long made = r->accepted + r->rejected;
    if (made == 0 || made%STUCK_STEPS || made == m->marked) return 0;
    const int stuck = m->t - m->mark < STUCK*(m->problem->end - m->problem->start);
    m->mark = m->t;
    m->marked = made;
    if (stuck) r->component = worst_entry(m);
    return stuck;
}

int ordernm_go(ordernm_motion *m, ordernm_results *r, double seconds)
{
    const ordernm_problem *const p = m->problem;
    const double deadline = seconds > 0.0 ? seconds_now() + seconds : INFINITY;
    int reason = ORDERNM_ENDED;
    m->results = r;
    r->t = m->t;
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
        if ((reason = plan(m, &step)) != ORDERNM_ENDED) break;
        const int status = attempt(m, &step);
        if (wants_precise(m)) return ORDERNM_IMPRECISE;
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
