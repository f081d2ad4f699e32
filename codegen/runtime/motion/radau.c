/* Radau IIA of order 5 with three stages, for stiff systems: a step, its error, and the interpolant.
 *
 * E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., Springer 1996, section IV.8, and their code RADAU5. The
 * stages z + Z[i] satisfy Z[i] = h*sum(a[i][j]*rate[j]). With A^-1 = T*L*T^-1, where L contains one real eigenvalue and a pair of complex
 * ones, Newton's method on W = T^-1*Z needs one real and one complex factorisation of the size of the state. The Jacobian J is exact. It is
 * used again while Newton's method converges fast, and its factors while the step size is the same.
 *
 * The unknowns are the n independent coordinates and speeds. Integrals are sums of the stages' outputs, computed afterwards. At each stage,
 * dependent coordinates are predicted by their values from Newton's previous iteration.
 *
 * Derivatives are those of the step actually made. Their error is the error of Z times second derivatives. So, with directions or with
 * steps stored for the adjoint, Newton's method continues further below the tolerance. */
#include "radau.h"

#include <math.h>
#include <string.h>

enum {
    ITERATIONS = 7,
    FIXED_ITERATIONS = 30,    /* maximum number of iterations if a smaller step is impossible */
    LARGEST_FORMED = 24       /* largest order of a system whose Jacobians at the stages are formed */
};

/* Convergence rate of Newton's method below which J is kept. */
static const scalar FAST = 1e-3;

/* Largest change of the stages, in tolerances, at which Newton's method has converged. */
static const scalar SOLVED = 0.03;

/* Factor on SOLVED if there are directions, if steps are stored for the adjoint, or if steps are constant. */
static const scalar CLOSER = 1e-2;

/* The step size and the factors are kept if the next step could be larger by at most this factor. */
static const scalar KEEP_BELOW = 1.2;

static const scalar SAFETY = 0.9, LEAST_CHANGE = 0.2, LARGEST_CHANGE = 8.0;

/* If a step exceeds the previous one by a larger factor, such as after an event, stages and convergence of the previous one do not help. */
static const scalar FARTHEST = 10.0;

/* ---- Memory. ---- */

/* Lays out, for n independent entries, Jacobians at the stages and the factors of their equations. Returns the number of bytes; does
 * nothing else if `at` is 0. */
size_t ordernm_radau_layout_stages(ordernm_motion *m, int n, void *at)
{
    memory of = {(char *)at, 0};
    struct radau none, *const r = at ? m->radau : &none;
    const long square = (long)n*n;
    for (int i = 0; i < STAGES; ++i) {
        r->at_stage[i] = ordernm_numbers(&of, square);
        r->along[i] = ordernm_numbers(&of, (long)n*LANES);
    }
    r->whole = ordernm_numbers(&of, STAGES*STAGES*square);
    r->of_whole = ordernm_numbers(&of, STAGES*(long)n*LANES);
    r->whole_pivot = (int *)ordernm_take(&of, (STAGES*n + 1)*sizeof(int));
    return of.used;
}

/* Lays out the method's own memory, aligned to a cache line. Returns the number of bytes; does nothing else if `at` is 0. */
size_t ordernm_radau_layout(ordernm_motion *m, void *at)
{
    memory of = {(char *)at, 0};
    const ordernm_system *s = m->system;
    struct radau none, *r = (struct radau *)ordernm_take(&of, sizeof *r);
    if (!at) r = &none;
    memset(r, 0, sizeof *r);
    const int n = r->n = m->ny;
    r->nq = s->nfree_q;
    const long square = (long)n*n;
    reduction *const a = &r->of_step, *const b = &r->of_stages;
    int **indices[] = {&a->kept, &a->place, &a->reduced, &a->partner, &b->kept, &b->place, &b->reduced, &b->partner,
        &r->real_pivot, &r->pivot};
    for (size_t i = 0; i < sizeof indices/sizeof *indices; ++i) *indices[i] = (int *)ordernm_take(&of, (n + 1)*sizeof(int));
    r->column = ordernm_numbers(&of, square);
    r->jacobian = ordernm_numbers(&of, (long)n*n);
    /* Jacobians at the stages are formed if they need fewer calls than sweeps do. Jacobians need calls for all columns, and one call for
     * every group of directions; sweeps need at least three calls for every group. For larger orders, factors of three times the order
     * cost more than sweeps (measured: 0.7 as much at order 8, twice as much at 35). */
    r->formed = m->ngroups && n <= LARGEST_FORMED && (n + LANES - 1)/LANES <= 2*m->ngroups;
    r->real = ordernm_numbers(&of, square), r->re = ordernm_numbers(&of, square), r->im = ordernm_numbers(&of, square);
    r->seeded = ordernm_numbers(&of, m->values + (long)n*LANES);
    r->seeded_rate = ordernm_numbers(&of, m->values + (long)(n + m->nx)*LANES);
    const group columns = {LANES, ORDERNM_EIGHT, 0, 0, m->values, ordernm_numbers(&of, (long)s->np*LANES)};
    r->columns = columns;
    for (int i = 0; i < STAGES; ++i) {
        r->stage[i] = ordernm_numbers(&of, m->size);
        r->last[i] = ordernm_numbers(&of, m->size);
        r->right[i] = ordernm_numbers(&of, (long)n*LANES);
    }
    for (int i = 0; i < 5; ++i) r->scratch[i] = ordernm_numbers(&of, (long)n*LANES);
    r->scale = ordernm_numbers(&of, n);
    r->infinite = ordernm_numbers(&of, n);
    r->leniency = fmax(0.1*pow(m->problem->rtol > 0.0 ? fmax(m->problem->rtol, 1e-14) : 1e-8, -1.0/3.0), 1.0);
    r->slowness = r->sweep_slowness = r->flow_slowness = 1.0;
    r->of_jacobian = ordernm_numbers(&of, m->values);
    if (at) m->radau = r;
    if (m->ngroups || ordernm_may_be_steep(m)) {
        void *const stages = ordernm_take(&of, ordernm_radau_layout_stages(m, n, 0));
        if (at) ordernm_radau_layout_stages(m, n, stages);
    }
    return of.used;
}

/* ---- Stages. ---- */

/* Factors of Z[i] in the polynomial through the step's start and its stages, at theta: z + sum(weight*Z). */
void ordernm_radau_weights(scalar theta, scalar *w)
{
    for (int j = 0; j < STAGES; ++j) {
        w[j] = theta/TIME[j];
        for (int k = 0; k < STAGES; ++k)
            if (k != j) w[j] *= (theta - TIME[k])/(TIME[j] - TIME[k]);
    }
}

static int follows(const struct radau *r, scalar h) { return r->accepted && h <= FARTHEST*r->h_last; }

/* Starting values of the stages: the polynomial of the previous step. */
static void extrapolate(ordernm_motion *m, scalar h)
{
    struct radau *const r = m->radau;
    if (!follows(r, h)) {
        for (int i = 0; i < STAGES; ++i) memset(r->stage[i], 0, m->size*sizeof(scalar));
        return;
    }
    for (int i = 0; i < STAGES; ++i) {
        scalar w[STAGES];
        ordernm_radau_weights(1.0 + TIME[i]*h/r->h_last, w);
        w[2] -= 1.0;
        for (long k = 0; k < m->size; ++k)
            r->stage[i][k] = w[0]*r->last[0][k] + w[1]*r->last[1][k] + w[2]*r->last[2][k];
    }
}

/* Computes J at z. */
static int renew(ordernm_motion *m)
{
    struct radau *const r = m->radau;
    const int status = r->formed_here ? 0 : ordernm_radau_differentiate(m, m->t, m->z, r->jacobian, 0);
    if (status) return status;
    if (r->formed_here) memcpy(r->jacobian, r->at_stage[2], (long)r->n*r->n*sizeof(scalar));
    ordernm_radau_take_jacobian(r);
    memcpy(r->of_jacobian, m->z, m->values*sizeof(scalar));
    r->t_of_jacobian = m->t;
    r->segment_of_jacobian = m->segment;
    r->jacobian_here = 1;
    return 0;
}

/* Newton's method on the stages. `limit` is the largest change at convergence, in tolerances; `usual` is the limit that suffices if
 * rounding prevents this. */
static int iterate(ordernm_motion *m, scalar h, scalar limit, scalar usual)
{
    struct radau *const r = m->radau;
    const int n = r->n, fixed = m->problem->fixed, most = fixed ? FIXED_ITERATIONS : ITERATIONS;
    scalar before = 0.0, ratio_before = 0.0;
    r->slowness_before = r->slowness;
    r->slowness = pow(fmax(r->slowness, ORDERNM_EPSILON), 0.8);
    r->theta = FAST;
    for (int k = 1; k <= most; ++k) {
        for (int i = 0; i < STAGES; ++i) {
            const int status = ordernm_radau_rates(m, h, i, 0, 0, RATES);
            if (status) return status;
        }
        ordernm_radau_correct(m, h, 0, 1);
        scalar sum = 0.0;
        for (int i = 0; i < n; ++i)
            for (int j = 0; j < STAGES; ++j) {
                const scalar x = r->right[j][i]/r->scale[i];
                sum += x*x;
            }
        const scalar size = sqrt(sum/(STAGES*n));
        if (!(size < INFINITY)) return DIVERGED;
        if (k > 1) {
            const scalar ratio = size/before;
            r->theta = k == 2 ? ratio : sqrt(ratio*ratio_before);
            ratio_before = ratio;
            if (!(r->theta < 0.99)) {
                if (size > usual) return DIVERGED;
                r->theta = 0.5;
            }
            r->slowness = r->theta/(1.0 - r->theta);
            const scalar end = fixed ? 0.0 : r->slowness*size*pow(r->theta, ITERATIONS - 1 - k);
            if (end > limit && end > usual) {
                /* Too many iterations would be needed: reduces the step. */
                const scalar excess = fmin(fmax(end/limit, 1e-4), 20.0);
                m->advice = 0.8*pow(excess, -1.0/(4 + ITERATIONS - 1 - k));
                return DIVERGED;
            }
        }
        before = fmax(size, ORDERNM_EPSILON);
        r->iterations = k;
        if (r->slowness*size <= limit) return CONVERGED;
        if (k == most && r->slowness*size <= usual) return CONVERGED;
    }
    return DIVERGED;
}

/* Computes J and its factors if necessary, then applies Newton's method. Repeats with the current J if that of an earlier state fails. */
static int stages(ordernm_motion *m, scalar h, scalar limit, scalar usual)
{
    struct radau *const r = m->radau;
    for (;;) {
        int status;
        if (r->theta > FAST && !r->jacobian_here && (status = renew(m))) return status;
        if (r->h_factored != h && ordernm_radau_factorise(m, h)) return DIVERGED;
        m->advice = 0.0;
        status = iterate(m, h, limit, usual);
        if (status == CONVERGED || r->jacobian_here) return status;
        r->theta = 1.0;
        extrapolate(m, h);
    }
}

/* ---- Steps. ---- */

/* Integrals, of the values or along a group: sums over the stages. */
static int integrate(ordernm_motion *m, scalar h, const group *g, int closed)
{
    struct radau *const r = m->radau;
    for (int i = 0; i < STAGES; ++i) {
        const int status = ordernm_radau_rates(m, h, i, g, 0, INTEGRALS | closed);
        if (status) return status;
    }
    const int width = g ? g->width : 1;
    const long first = (g ? g->at : 0) + (long)m->ny*width, end = first + (long)m->nx*width;
    for (int i = 0; i < STAGES; ++i)
        for (long k = first; k < end; ++k)
            r->stage[i][k] = h*(A[i][0]*m->rate[1][k] + A[i][1]*m->rate[2][k] + A[i][2]*m->rate[3][k]);
    return 0;
}

/* The error of the values or along a group: (REAL/h - J) error = REAL/h*(...). Integrals do not affect other entries. */
static void estimate(ordernm_motion *m, scalar h, const group *g, const scalar *rate)
{
    const struct radau *const r = m->radau;
    const int width = g ? g->width : 1;
    const long at = g ? g->at : 0, n = (long)(m->ny + m->nx)*width;
    scalar *const error = m->error[0] + at;
    for (long k = 0; k < n; ++k)
        error[k] = rate[at + k]
            + (E[0]*r->stage[0][at + k] + E[1]*r->stage[1][at + k] + E[2]*r->stage[2][at + k])/h;
    ordernm_radau_solve_real(r, error, width);
    for (long k = (long)m->ny*width; k < n; ++k) error[k] *= h/REAL;
}

/* Judges the solution, of order 5, by the error estimate, of order 3. RADAU5 accepts estimates that grow with the tolerance to the power
 * 2/3, which assumes that the terms of a series decrease as in smooth motions of size one. Here the decrease must be observed. If the terms
 * of the series decrease by a constant factor per power of h, this factor is (error/change)^(1/3), because the change of an entry is of
 * first power and its estimated error of fourth. The error of sixth power is then change*(error/change)^(5/3). A tenth of RADAU5's
 * allowance is used. */
static void judge(ordernm_motion *m, scalar h, const group *g)
{
    const struct radau *const r = m->radau;
    const int width = g ? g->width : 1;
    const long at = g ? g->at : 0, n = (long)(m->ny + m->nx)*width;
    for (long k = at; k < at + n; ++k) {
        scalar change = h*fabs(m->rate[0][k]);
        for (int i = 0; i < STAGES; ++i) change = fmax(change, fabs(r->stage[i][k]));
        const scalar ratio = change/fabs(m->error[0][k]);
        if (ratio > 30.0) m->error[0][k] /= fmin(0.1*cbrt(ratio*ratio), r->leniency);
    }
}

/* The next step size, by the errors of this step and of the one before (K. Gustafsson). */
static scalar next_step(const ordernm_motion *m, scalar h, scalar error)
{
    const struct radau *const r = m->radau;
    if (error != error) return 0.5;
    const scalar effort = SAFETY*(1 + 2*ITERATIONS)/(r->iterations + 2*ITERATIONS);
    const scalar safety = effort < SAFETY ? effort : SAFETY;
    scalar quotient = pow(error, 0.25)/safety;
    if (error < 1.0 && r->error_accepted > 0.0) {
        const scalar predicted = r->h_accepted/h*pow(error*error/r->error_accepted, 0.25)/SAFETY;
        quotient = fmax(quotient, fmin(predicted, 1.0/LEAST_CHANGE));
    }
    return 1.0/fmin(fmax(quotient, 1.0/LARGEST_CHANGE), 1.0/LEAST_CHANGE);
}

/* Keeps the stages of an accepted step for the next one. */
static void go_on(struct radau *r, scalar h)
{
    for (int i = 0; i < STAGES; ++i) {
        scalar *const before = r->last[i];
        r->last[i] = r->stage[i];
        r->stage[i] = before;
    }
    r->h_last = h;
    r->jacobian_here = 0;
    ++r->accepted;
}

/* Forgets the previous step, for instance after a switch. */
static void begin_anew(struct radau *r)
{
    r->accepted = 0;
    r->theta = 1.0;
}

/* Tolerances, and limits of Newton's method; see iterate. */
static void limits(ordernm_motion *m, scalar *limit, scalar *usual)
{
    const struct radau *const r = m->radau;
    const ordernm_problem *const p = m->problem;
    for (int i = 0; i < r->n; ++i) r->scale[i] = p->atol[i] + p->rtol*fabs(m->z[i]);
    const scalar least = 10.0*ORDERNM_EPSILON/fmax(p->rtol, 1e-14);
    *usual = fmax(least, SOLVED);
    *limit = m->ngroups || p->fixed || m->results->steps ? fmax(least, CLOSER**usual) : *usual;
}

/* Computes the end of the step from the stages; closes the loops if derivatives are needed. */
static int ends(ordernm_motion *m, scalar h)
{
    struct radau *const r = m->radau;
    int status = m->nx ? integrate(m, h, 0, 0) : 0;
    if (m->nd && !m->nx && (m->ngroups || m->results->steps))
        for (int i = 0; i < STAGES && !status; ++i) status = ordernm_radau_rates(m, h, i, 0, 0, 0);
    if (status) return status;
    for (long k = 0; k < m->values; ++k) m->next[k] = m->z[k] + r->stage[2][k];
    /* Integrates dependent coordinates by their rates, for comparison with those that close the loops. */
    for (long k = m->ny + m->nx; k < m->ny + m->nx + m->nd; ++k)
        m->next[k] = m->z[k] + h*(A[2][0]*m->rate[1][k] + A[2][1]*m->rate[2][k] + A[2][2]*m->rate[3][k]);
    return 0;
}

/* Derivatives at the end of the step along all directions. Returns CONVERGED, DIVERGED, or the status of a function. */
static int ends_along(ordernm_motion *m, scalar h)
{
    struct radau *const r = m->radau;
    const int closed = m->system->split ? 0 : KNOWN_CLOSED;
    int formed = 0, status = CONVERGED;
    for (int n = 0; n < m->ngroups + m->flowing; ++n) {
        const group *const g = m->groups + n;
        status = ordernm_radau_along(m, h, g, closed, &formed);
        if (status == DIVERGED && n == m->ngroups) m->flow_unknown = 1, status = CONVERGED;
        if (status != CONVERGED) return status;
        if (m->nx && (status = integrate(m, h, g, closed))) return status;
        const long end = g->at + (long)(m->ny + m->nx)*g->width;
        for (long k = g->at; k < end; ++k) m->next[k] = m->z[k] + r->stage[2][k];
        if (!m->problem->atol_directions || n == m->ngroups) continue;
        estimate(m, h, g, m->rate[0]);
        judge(m, h, g);
    }
    return CONVERGED;
}

/* At the start of a step: decides which data of the previous step, such as its Jacobian, are used again. Returns the status of a
 * function. */
static int take_up(ordernm_motion *m, scalar h)
{
    struct radau *const r = m->radau;
    if (r->tried && m->t != r->t_tried) { /* the last tried step has been accepted */
        go_on(r, r->h_tried);
        r->formed_here = r->formed && m->identity && m->segment == r->segment && !m->switched;
        if (m->switched || m->t == m->root_end) begin_anew(r);
    }
    if ((m->ngroups || m->flowing) && (!r->tried || m->system->split || m->segment != r->segment || m->switched)) {
        /* Rates by the function without directions, so that steps are the same to the last bit with and without directions. */
        const int status = ordernm_rates_of(m, m->t, m->z, m->rate[0], 0, 0, RATES);
        if (status) return status;
    }
    r->tried = 1;
    r->t_tried = m->t;
    r->segment = m->segment;
    r->h_tried = h;
    if (!r->accepted) r->theta = 1.0;
    return 0;
}

static int radau_step(ordernm_motion *m, scalar h, scalar *error)
{
    struct radau *const r = m->radau;
    const ordernm_problem *const p = m->problem;
    int status = take_up(m, h);
    if (status) return status;
    scalar limit, usual;
    limits(m, &limit, &usual);
    /* near the zero of a power, even errors far below the tolerances limit the step; see powers.c */
    if (!follows(r, h) || (m->derived && m->beside_power)) r->slowness = 1.0;
    extrapolate(m, h);
    status = stages(m, h, limit, usual);
    if (status == DIVERGED) {
        if (m->advice <= 0.0) m->advice = 0.5;
        *error = NAN;
        return 0;
    }
    if (status != CONVERGED) return status;
    if ((status = ends(m, h))) return status;
    estimate(m, h, 0, m->rate[0]);
    judge(m, h, 0);
    if (p->atol_directions) memset(m->error[0] + m->values, 0, (m->size - m->values)*sizeof(scalar));
    *error = ordernm_error_norm(m, m->next, m->error[0], m->zeros);
    if (*error > 1.0 && !p->fixed && (!r->accepted || m->rejected_before)) {
        /* Filters the stiff components of the error estimate once more. */
        estimate(m, h, 0, m->rate[0]);
        for (long k = 0; k < m->values; ++k) m->trial[k] = m->z[k] + (k < m->ny ? m->error[0][k] : 0.0);
        if (!ordernm_rates_of(m, m->t, m->trial, m->rate[1], 0, 0, m->nx ? RATES | INTEGRALS : RATES)) {
            estimate(m, h, 0, m->rate[1]);
            judge(m, h, 0);
            *error = ordernm_error_norm(m, m->next, m->error[0], m->zeros);
        }
    }
    const int refused = !(*error <= 1.0) && !(p->fixed && *error < INFINITY);
    if (!refused && (status = ends_along(m, h)) != CONVERGED) {
        if (status != DIVERGED) return status;
        r->theta = 1.0;
        m->advice = r->jacobian_here ? 0.5 : 0.999;
        *error = NAN;
        return 0;
    }
    if (!refused && p->atol_directions) *error = ordernm_error_norm(m, m->next, m->error[0], m->zeros);
    scalar change = next_step(m, h, *error);
    if (p->fixed) *error = *error < INFINITY ? 0.0 : NAN;
    if (*error <= 1.0) {
        /* without outputs, which have been computed at this state already */
        if ((status = ordernm_rates_of(m, m->t + h, m->next, m->rate[3], 0, 0, RATES))) return status;
        r->h_accepted = h;
        r->error_accepted = fmax(1e-2, *error);
        if (change >= 1.0 && change <= KEEP_BELOW) change = 1.0;
    } else if (!r->accepted) {
        change = 0.1;
    }
    m->advice = change;
    return 0;
}

static int radau_complete(ordernm_motion *m, scalar h)
{
    (void)m, (void)h;
    return 0;
}

static void radau_interpolate(ordernm_motion *m, scalar h, scalar theta, scalar *z)
{
    (void)h;
    static const int every[STAGES] = {0, 1, 2};
    scalar w[STAGES];
    ordernm_radau_weights(theta, w);
    ordernm_combine(m->size, z, m->z, 1.0, STAGES, every, w, m->radau->stage);
}

static const scalar TIMES[] = {0.0, 0.15505102572168219018, 0.64494897427831780982, 1.0};

/* ---- Stored and repeated steps. ---- */

/* Stores the data that determine where Newton's method ends. row[2]: whether J was computed in this step, and which stages are in long
 * double. row[3]: the expected convergence rate. Then the stages. Before the first of several steps, `known` gets the starting data: the
 * stages of the step before, and the state at which J was computed. */
static void radau_keep(const ordernm_motion *m, scalar *row)
{
    const struct radau *const r = m->radau;
    const long state = m->ny + m->nx + m->nd;
    row[2] = r->jacobian_here + 2.0*m->precise_stages;
    row[3] = r->slowness_before;
    scalar *to = row + m->head + state;
    for (int i = 0; i < STAGES; ++i)
        for (long k = 0; k < state; ++k) *to++ = m->z[k] + r->stage[i][k];
    scalar *const known = m->results->known;
    if (!known || m->results->steps_count) return;
    known[0] = r->accepted > 0;
    known[1] = r->h_last;
    known[2] = r->t_of_jacobian;
    known[3] = r->segment_of_jacobian;
    memcpy(known + 4, r->of_jacobian, m->values*sizeof(scalar));
    for (int i = 0; i < STAGES; ++i) memcpy(known + 4 + (1 + i)*m->values, r->last[i], m->values*sizeof(scalar));
}

int ordernm_radau_replay(ordernm_motion *m, const scalar *known, scalar *row)
{
    struct radau *const r = m->radau;
    const scalar h = row[1];
    int status;
    if (known) {
        r->accepted = known[0] != 0.0;
        r->h_last = known[1];
        const long segment = m->segment;
        m->segment = (long)known[3];
        memcpy(r->of_jacobian, known + 4, m->values*sizeof(scalar));
        if ((status = ordernm_radau_differentiate(m, known[2], r->of_jacobian, r->jacobian, 0))) return status;
        m->segment = segment;
        ordernm_radau_take_jacobian(r);
        for (int i = 0; i < STAGES; ++i) memcpy(r->last[i], known + 4 + (1 + i)*m->values, m->values*sizeof(scalar));
    } else {
        go_on(r, r->h_tried);
        if (m->switched || m->t == m->root_end) begin_anew(r);
    }
    r->h_tried = h;
    r->jacobian_here = 0;
    if ((unsigned)row[2] & 1u && (status = renew(m))) return status;
    if (r->h_factored != h && ordernm_radau_factorise(m, h)) return -1;
    r->slowness = row[3];
    scalar limit, usual;
    limits(m, &limit, &usual);
    extrapolate(m, h);
    if ((status = iterate(m, h, limit, usual)) != CONVERGED) return status;
    return ends(m, h);
}

const scheme ordernm_radau = {STAGES, STAGES + 1, 4, radau_step, radau_complete, radau_interpolate, 0, TIMES, 0, 1, 0.4, radau_keep};
