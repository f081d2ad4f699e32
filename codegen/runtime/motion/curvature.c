/* Hessian products of functionals by the discrete adjoint, along directions: tangents of the original steps forwards, then the adjoint
 * and its tangents backwards.
 *
 * With the notation of explicit_backwards.c, and d for changes along a direction,
 *
 *     dY_i = dz + h sum a_ij dk_j,  dkappa_j = h (b_j dlambda + sum_i>j a_ij dnu_i),
 *     dnu_j = f_z(Y_j)^T dkappa_j + (f_zz dY_j + f_zp dp)^T kappa_j,  dlambda <- dlambda + sum dnu_j.
 *
 * One function computes both terms of dnu_j and f_z^T kappa. Adjoints have the layout of the state z: values, then tangents along the
 * directions. */
#include "inside.h"

#include <string.h>

/* Derivatives of a function with respect to its arguments. */
typedef struct {
    scalar *q, *u, *p, *inputs, *t;
} gradient;

struct ordernm_curvature {
    ordernm_problem problem;
    ordernm_results none;
    ordernm_hessians *found;
    ordernm_motion *motion;
    int n, all;                       /* entries of the state with derivatives; stages of a step with those of its interpolant */
    long next, left;                  /* numbers of times passed forwards, and still to process backwards */
    scalar *lambda, *kappa[MOST_STAGES], *nu;
    gradient values, along;           /* results: of one vector of weights, and in lanes */
    scalar *no_dt;                    /* zeros for time */
    scalar *p;                        /* sums of gradients by parameters along directions, in lanes by group */
    scalar *b, *db;                   /* weights of udot, and their tangents; zero for dependent speeds */
    scalar *rate_weights, *dqdot;     /* the same for the rates of coordinates that are not speeds */
};

static size_t lay_out(ordernm_curvature *c, const ordernm_problem *problem, long size)
{
    const ordernm_system *const s = problem->system;
    memory of = {(char *)c, 0};
    ordernm_curvature none;
    ordernm_take(&of, sizeof none);
    if (!c) c = &none;
    c->lambda = ordernm_numbers(&of, size);
    c->nu = ordernm_numbers(&of, size);
    for (int i = 0; i < MOST_STAGES; ++i) c->kappa[i] = ordernm_numbers(&of, size);
    gradient *const both[] = {&c->along, &c->values};
    for (int i = 0; i < 2; ++i) {
        gradient *const g = both[i];
        const long lanes = i ? 1 : LANES;
        g->q = ordernm_numbers(&of, s->nq*lanes);
        g->u = ordernm_numbers(&of, s->nu*lanes);
        g->p = ordernm_numbers(&of, s->np*lanes);
        g->inputs = ordernm_numbers(&of, s->ninputs*lanes);
        g->t = ordernm_numbers(&of, lanes);
    }
    c->no_dt = ordernm_numbers(&of, LANES);
    c->p = ordernm_numbers(&of, s->np*(problem->ndirections + LANES));
    c->b = ordernm_numbers(&of, s->nu);
    c->db = ordernm_numbers(&of, s->nu*LANES);
    c->rate_weights = ordernm_numbers(&of, s->nq);
    c->dqdot = ordernm_numbers(&of, s->nq*LANES);
    return of.used;
}

/* An upper bound of the size of a state with derivatives. */
static long most(const ordernm_problem *p)
{
    const long n = p->system->nq + p->system->nu + p->nintegrals;
    return ordernm_whole_lines(n) + (p->ndirections + LANES)*ordernm_whole_lines(n);
}

long ordernm_hessians_room(const ordernm_problem *problem)
{
    return 8 + (long)(lay_out(0, problem, most(problem))/sizeof(scalar)) + ordernm_room(problem);
}

ordernm_curvature *ordernm_hessians_begin(const ordernm_problem *problem, ordernm_hessians *found, scalar *room)
{
    ordernm_curvature *const c = (ordernm_curvature *)ordernm_line(room);
    const size_t used = lay_out(0, problem, most(problem));
    memset(c, 0, used);
    lay_out(c, problem, most(problem));
    c->problem = *problem;
    c->found = found;
    c->motion = ordernm_begin(&c->problem, (scalar *)((char *)c + used));
    c->motion->results = &c->none;
    c->n = problem->system->nfree_q + problem->system->nfree_u;
    c->all = c->motion->method->all;
    return c;
}

int ordernm_hessians_stages(const ordernm_curvature *c) { return c->all; }

/* ---- Rows of Python's layout: the values, then the derivatives along each direction. A record ends with all coordinates (models
 * with loops), then the tangents of udot in lanes, group by group. ---- */

static long size_of_rows(const ordernm_curvature *c) { return (1L + c->problem.ndirections)*c->n; }

/* Index of the tangents of udot in a record. */
static long rates_at(const ordernm_curvature *c)
{
    return size_of_rows(c) + (c->motion->identity ? 0 : c->motion->system->nq);
}

long ordernm_hessians_record(const ordernm_curvature *c)
{
    const ordernm_motion *const m = c->motion;
    long lanes = 0;
    for (const group *g = m->groups; g < m->groups + m->ngroups; ++g) lanes += g->width;
    return rates_at(c) + lanes*m->system->nu;
}

static void unpack(const ordernm_curvature *c, const scalar *z, scalar *to)
{
    const ordernm_motion *const m = c->motion;
    memcpy(to, z, c->n*sizeof(scalar));
    for (const group *g = m->groups; g < m->groups + m->ngroups; ++g)
        for (int l = 0; l < g->used; ++l)
            for (int i = 0; i < c->n; ++i) to[(1 + g->first + l)*c->n + i] = z[g->at + (long)i*g->width + l];
}

static void pack(const ordernm_curvature *c, const scalar *from, scalar *z)
{
    const ordernm_motion *const m = c->motion;
    memcpy(z, from, c->n*sizeof(scalar));
    for (const group *g = m->groups; g < m->groups + m->ngroups; ++g)
        for (int l = 0; l < g->used; ++l)
            for (int i = 0; i < c->n; ++i) z[g->at + (long)i*g->width + l] = from[(1 + g->first + l)*c->n + i];
}

/* A record of a state whose loops have just been closed. */
static void keep(const ordernm_curvature *c, const scalar *z, scalar *to)
{
    const ordernm_motion *const m = c->motion;
    unpack(c, z, to);
    if (!m->identity) memcpy(to + size_of_rows(c), m->q, m->system->nq*sizeof(scalar));
}

/* Rates at a stage, and its record. With loops, m->dudot contains the tangents of udot only until the next group is computed. */
static int rates_and_keep(const ordernm_curvature *c, scalar t, const scalar *z, scalar *rate, scalar *to)
{
    ordernm_motion *const m = c->motion;
    const ordernm_system *const s = m->system;
    scalar *dudot = to + rates_at(c);
    for (group *g = m->groups; g < m->groups + m->ngroups; dudot += s->nu*g++->width) {
        const int status = ordernm_rates_of(m, t, z, rate, 1, g, RATES);
        if (status) return status;
        memcpy(dudot, m->identity ? rate + g->at + s->nq*g->width : m->dudot, s->nu*g->width*sizeof(scalar));
    }
    keep(c, z, to);
    return 0;
}

static int close_and_keep(const ordernm_curvature *c, scalar t, const scalar *z, scalar *to)
{
    ordernm_call call;
    ordernm_arguments(c->motion, t, z, &call);
    const int status = ordernm_close_loops(c->motion, &call);
    if (!status) keep(c, z, to);
    return status;
}

/* ---- Forwards. ---- */

static const int every[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};

/* The states at the times of outputs within a step, from the rates of its stages. */
static int states_within(ordernm_curvature *c, scalar h, scalar until)
{
    ordernm_motion *const m = c->motion;
    ordernm_hessians *const found = c->found;
    scalar factor[MOST_STAGES];
    for (; c->next < found->ntimes && found->times[c->next] <= until; ++c->next) {
        m->method->weights((found->times[c->next] - m->t)/h, factor);
        ordernm_combine(m->size, m->trial, m->z, h, c->all, every, factor, m->rate);
        const int status = close_and_keep(c, found->times[c->next], m->trial, found->states + c->next*ordernm_hessians_record(c));
        if (status) return status;
    }
    return 0;
}

int ordernm_tangents(ordernm_curvature *c, const scalar *steps, long count, scalar until, scalar *stages, scalar *nodes)
{
    ordernm_motion *const m = c->motion;
    const scheme *const method = m->method;
    const row *const end = method->rows + method->stages;
    const long size = ordernm_step_size(m->problem), record = ordernm_hessians_record(c);
    int status;
    for (long k = 0; k < count; ++k, steps += size, stages += c->all*record, nodes += 2*c->all) {
        const scalar h = steps[1], to = k + 1 < count ? steps[size] : until;
        m->t = steps[0];
        memcpy(m->z, steps + m->head, (m->ny + m->nx + m->nd)*sizeof(scalar));
        if (!(h > 0.0)) continue;
        ordernm_find_segment(m, m->t, h);
        if (!m->identity) ordernm_take_derivatives(m, steps[4]);
        if (c->next < c->found->ntimes && c->found->times[c->next] <= m->t) { /* only at the motion's start */
            if ((status = close_and_keep(c, m->t, m->z, c->found->states + c->next*record))) return status;
            ++c->next;
        }
        const int within = c->next < c->found->ntimes && c->found->times[c->next] <= to;
        for (int i = 0; i < (within ? c->all : method->stages); ++i) {
            const row *const r = method->rows + i;
            if (i) ordernm_combine(m->size, m->trial, m->z, h, r->count, r->which, r->factor, m->rate);
            const scalar *const z = i ? m->trial : m->z;
            if ((status = rates_and_keep(c, m->t + method->times[i]*h, z, m->rate[i], stages + i*record))) return status;
            nodes[2*i] = m->t + method->times[i]*h;
        }
        if (within && (status = states_within(c, h, to))) return status;
        for (int j = 0; j < end->count; ++j) nodes[2*end->which[j] + 1] = h*end->factor[j];
        ordernm_combine(m->size, m->next, m->z, h, end->count, end->which, end->factor, m->rate);
        ordernm_exchange(&m->z, &m->next);
    }
    return 0;
}

int ordernm_hessians_state(ordernm_curvature *c, scalar t, scalar *to) { return close_and_keep(c, t, c->motion->z, to); }

/* ---- Backwards. ---- */

/* Converts gradients by inputs at a time to gradients by control points, and adds these; `from` is 0 for values, 1 + k for direction k. */
static void add_inputs(ordernm_curvature *c, scalar t, const scalar *of, int width, long from, int used, scalar factor)
{
    ordernm_motion *const m = c->motion;
    const ordernm_system *const s = m->system;
    const ordernm_inputs *const in = &m->problem->inputs;
    scalar value[ORDERNM_ORDERS][ORDERNM_MOST_DEGREE + 1];
    const int signals = ordernm_signals(s);
    const long first = ordernm_input_weights(m, t, value);
    for (int i = 0; i < s->ninputs; ++i) {
        int order;
        const int signal = ordernm_signal_of(s, i, &order);
        for (int b = 0; b <= in->degree; ++b)
            for (int l = 0; l < used; ++l)
                c->found->inputs[((from + l)*in->count + first + b)*signals + signal] += factor*value[order][b]*of[i*width + l];
    }
}

/* Adds the results of a function to an adjoint and to the gradients: of values, or of the directions of a group. */
static void add(ordernm_curvature *c, scalar t, const gradient *of, scalar *nu, const group *g)
{
    const ordernm_system *const s = c->motion->system;
    const int width = g ? g->width : 1, used = g ? g->used : 1;
    const long from = g ? 1 + g->first : 0;
    scalar *const to = nu + (g ? g->at : 0);
    for (int i = 0; i < s->nfree_q; ++i)
        for (int l = 0; l < width; ++l) to[i*width + l] += of->q[s->free_q[i]*width + l];
    for (int i = 0; i < s->nfree_u; ++i)
        for (int l = 0; l < width; ++l) to[(s->nfree_q + i)*width + l] += of->u[s->free_u[i]*width + l];
    scalar *const p = g ? c->p + s->np*g->first : c->found->p;
    for (int i = 0; i < s->np*width; ++i) p[i] += of->p[i];
    if (s->ninputs) add_inputs(c, t, of->inputs, width, from, used, 1.0);
}

/* Adds the adjoints of coordinates to the adjoints of the speeds that are rates of these coordinates. */
static void add_rates(const ordernm_curvature *c, const scalar *kappa, scalar *nu, const group *g)
{
    if (!c->motion->system->plain_rates) return;
    const int n = c->motion->system->nfree_q*(g ? g->width : 1);
    const long at = g ? g->at : 0;
    for (int i = 0; i < n; ++i) nu[at + n + i] += kappa[at + i];
}

/* Clears results of a function that leaves some of them untouched. */
static void clear(ordernm_curvature *c, const gradient *of, int width)
{
    const ordernm_system *const s = c->motion->system;
    memset(of->q, 0, s->nq*width*sizeof(scalar));
    memset(of->u, 0, s->nu*width*sizeof(scalar));
    memset(of->p, 0, s->np*width*sizeof(scalar));
    memset(of->inputs, 0, s->ninputs*width*sizeof(scalar));
}

/* Arguments at the state of a record. */
static void at_record(ordernm_curvature *c, scalar t, const scalar *z, const scalar *record, ordernm_call *call)
{
    ordernm_arguments(c->motion, t, z, call);
    if (!c->motion->identity) call->q = record + size_of_rows(c);
}

/* Adds to nu, for values and along all directions, the derivatives of kappa^T f at the state of a record: f_z^T kappa and its changes. */
static int gradients(ordernm_curvature *c, scalar t, const scalar *z, const scalar *record, const scalar *kappa, scalar *nu)
{
    ordernm_motion *const m = c->motion;
    const ordernm_system *const s = m->system;
    const gradient *const v = &c->values, *const d = &c->along;
    const scalar *dudot = record + rates_at(c);
    for (const group *g = m->groups; g < m->groups + m->ngroups; dudot += s->nu*g++->width) {
        ordernm_call call;
        at_record(c, t, z, record, &call);
        ordernm_seeds(m, t, z, g, &call);
        call.dt = c->no_dt;
        if (s->nfree_u < s->nu) memset(c->db, 0, s->nu*g->width*sizeof(scalar));
        for (int i = 0; i < s->nfree_u; ++i) {
            c->b[s->free_u[i]] = kappa[s->nfree_q + i];
            memcpy(c->db + s->free_u[i]*g->width, kappa + g->at + (s->nfree_q + i)*g->width, g->width*sizeof(scalar));
        }
        call.b = c->b, call.db = c->db, call.found_dudot = dudot;
        call.gradient_q = v->q, call.gradient_u = v->u, call.gradient_p = v->p, call.gradient_inputs = v->inputs, call.gradient_t = v->t;
        call.dgq = d->q, call.dgu = d->u, call.dgp = d->p, call.dginputs = d->inputs, call.dgt = d->t;
        ++c->found->products;
        const int status = s->gradient_tangents[g->index](&call);
        if (status) return status;
        add(c, t, d, nu, g);
        add_rates(c, kappa, nu, g);
    }
    add(c, t, v, nu, 0);
    add_rates(c, kappa, nu, 0);
    return 0;
}

/* Adds the contribution of the rates of coordinates to nu, if these are not the speeds: the transpose, for values or for the directions of
 * a group. */
static int rates_transposed(ordernm_curvature *c, ordernm_call call, scalar t, const scalar *kappa, scalar *nu, const group *g)
{
    const ordernm_system *const s = c->motion->system;
    const int width = g ? g->width : 1;
    const gradient *const to = g ? &c->along : &c->values;
    clear(c, to, width);
    memset(c->dqdot, 0, s->nq*width*sizeof(scalar));
    for (int i = 0; i < s->nfree_q; ++i)
        memcpy(c->dqdot + s->free_q[i]*width, kappa + (g ? g->at : 0) + i*width, width*sizeof(scalar));
    call.qdot = c->motion->qdot, call.dqdot = c->dqdot;
    call.dq = to->q, call.du = to->u, call.dp = to->p, call.dinputs = to->inputs, call.dt = to->t;
    const int status = s->coordinate_rate_sensitivities_transposed[g ? g->index : ORDERNM_ONE](&call);
    if (!status) add(c, t, to, nu, g);
    return status;
}

/* Adds the contributions of the rates of coordinates to nu: the transpose, and its changes along all directions. */
static int rate_gradients(ordernm_curvature *c, scalar t, const scalar *z, const scalar *record, const scalar *kappa, scalar *nu)
{
    ordernm_motion *const m = c->motion;
    const ordernm_system *const s = m->system;
    const gradient *const d = &c->along;
    ordernm_call call;
    at_record(c, t, z, record, &call);
    int status = rates_transposed(c, call, t, kappa, nu, 0);
    for (const group *g = m->groups; !status && g < m->groups + m->ngroups; ++g) {
        if ((status = rates_transposed(c, call, t, kappa, nu, g))) break;
        clear(c, d, g->width);
        ordernm_seeds(m, t, z, g, &call);
        call.dt = c->no_dt;
        for (int i = 0; i < s->nfree_q; ++i) c->rate_weights[s->free_q[i]] = kappa[i];
        call.rate_weights = c->rate_weights;
        call.dgq = d->q, call.dgu = d->u, call.dgp = d->p, call.dginputs = d->inputs, call.dgt = d->t;
        status = s->coordinate_rate_hessian_products[g->index](&call);
        if (!status) add(c, t, d, nu, g);
    }
    return status;
}

static int any(const scalar *x, long n)
{
    for (long i = 0; i < n; ++i)
        if (x[i] != 0.0) return 1;
    return 0;
}

static void accumulate(scalar *to, scalar factor, const scalar *of, long n)
{
    for (long i = 0; i < n; ++i) to[i] += factor*of[i];
}

/* Adds `factor` times the derivatives of weighted outputs at a state, [1 + k][nq + nu + np + ninputs]. */
static void add_source(ordernm_curvature *c, scalar t, scalar factor, const scalar *source, scalar *nu)
{
    const ordernm_motion *const m = c->motion;
    const ordernm_system *const s = m->system;
    const long length = c->n + s->np + s->ninputs;
    for (long d = 0; d <= c->problem.ndirections; ++d, source += length) {
        const group *const g = d ? m->groups + (d - 1)/LANES : 0;
        const long at = g ? g->at + d - 1 - g->first : 0, stride = g ? g->width : 1;
        for (int i = 0; i < c->n; ++i) nu[at + i*stride] += factor*source[i];
        for (int i = 0; i < s->np; ++i) c->found->p[d*s->np + i] += factor*source[c->n + i];
        if (s->ninputs) add_inputs(c, t, source + c->n + s->np, 1, d, 1, factor);
    }
}

/* Adds the adjoints of the outputs at times within the current step. */
static void samples_back(ordernm_curvature *c, scalar h, const scalar *sources)
{
    ordernm_motion *const m = c->motion;
    const ordernm_hessians *const found = c->found;
    const long record = (1L + c->problem.ndirections)*(c->n + m->system->np + m->system->ninputs);
    scalar factor[MOST_STAGES];
    for (; c->left > 0 && found->times[c->left - 1] > m->t; --c->left) {
        const scalar at = found->times[c->left - 1];
        memset(c->nu, 0, m->size*sizeof(scalar));
        add_source(c, at, 1.0, sources + (c->left - 1)*record, c->nu);
        accumulate(c->lambda, 1.0, c->nu, m->size);
        m->method->weights((at - m->t)/h, factor);
        for (int j = 0; j < c->all; ++j) accumulate(c->kappa[j], h*factor[j], c->nu, m->size);
    }
}

static int step_back(ordernm_curvature *c, scalar h, const scalar *stages, const scalar *integrands)
{
    ordernm_motion *const m = c->motion;
    const ordernm_system *const s = m->system;
    const scheme *const method = m->method;
    const row *const end = method->rows + method->stages;
    const long record = ordernm_hessians_record(c);
    const long source = (1L + c->problem.ndirections)*(c->n + s->np + s->ninputs);
    scalar weight[MOST_STAGES] = {0.0};
    int status;
    for (int i = 0; i < c->all; ++i) memset(c->kappa[i], 0, m->size*sizeof(scalar));
    for (int j = 0; j < end->count; ++j) {
        weight[end->which[j]] = h*end->factor[j];
        accumulate(c->kappa[end->which[j]], h*end->factor[j], c->lambda, m->size);
    }
    if (c->left > 0 && c->found->times[c->left - 1] > m->t) samples_back(c, h, c->found->sources);
    for (int i = c->all - 1; i >= 0; --i) {
        const row *const r = method->rows + i;
        const scalar t = m->t + method->times[i]*h, *const kappa = c->kappa[i];
        const int integrand = integrands && weight[i] != 0.0, weighted = any(kappa, m->size);
        if (!integrand && !weighted) continue;
        pack(c, stages + i*record, m->trial);
        memset(c->nu, 0, m->size*sizeof(scalar));
        if (weighted && (status = gradients(c, t, m->trial, stages + i*record, kappa, c->nu))) return status;
        if (weighted && !s->plain_rates && (status = rate_gradients(c, t, m->trial, stages + i*record, kappa, c->nu))) return status;
        if (integrand) add_source(c, t, weight[i], integrands + i*source, c->nu);
        accumulate(c->lambda, 1.0, c->nu, m->size);
        for (int j = 0; j < r->count; ++j) accumulate(c->kappa[r->which[j]], h*r->factor[j], c->nu, m->size);
    }
    return 0;
}

void ordernm_hessians_turn(ordernm_curvature *c)
{
    memset(c->lambda, 0, c->motion->size*sizeof(scalar));
    memset(c->p, 0, c->problem.system->np*(c->problem.ndirections + LANES)*sizeof(scalar));
    if (c->found->finish) pack(c, c->found->finish, c->lambda);
    c->left = c->found->ntimes;
}

int ordernm_hessians_backwards(ordernm_curvature *c, const scalar *steps, long count, const scalar *stages, const scalar *integrands)
{
    ordernm_motion *const m = c->motion;
    const ordernm_system *const s = m->system;
    const long size = ordernm_step_size(m->problem), k = 1L + c->problem.ndirections;
    for (long i = count - 1; i >= 0; --i) {
        const scalar *const step = steps + i*size;
        m->t = step[0];
        if (!(step[1] > 0.0)) continue;
        ordernm_find_segment(m, m->t, step[1]);
        const long source = c->all*k*(c->n + s->np + s->ninputs);
        const int status = step_back(c, step[1], stages + i*c->all*ordernm_hessians_record(c), integrands ? integrands + i*source : 0);
        if (status) return status;
    }
    return 0;
}

void ordernm_hessians_end(ordernm_curvature *c)
{
    ordernm_motion *const m = c->motion;
    const ordernm_system *const s = m->system;
    const long source = (1L + c->problem.ndirections)*(c->n + s->np + s->ninputs);
    for (; c->left > 0; --c->left) add_source(c, m->t, 1.0, c->found->sources + (c->left - 1)*source, c->lambda);
    unpack(c, c->lambda, c->found->start);
    for (const group *g = m->groups; g < m->groups + m->ngroups; ++g)
        for (int l = 0; l < g->used; ++l)
            for (int i = 0; i < s->np; ++i) c->found->p[(1 + g->first + l)*s->np + i] += c->p[s->np*g->first + i*g->width + l];
}
