/* The discrete adjoint of explicit methods: every step backwards, with the transposes of the generated functions.
 *
 * A step is Y_i = z + h sum a_ij k_j, k_i = f(Y_i), z+ = z + h sum b_j k_j. From lambda = dJ/dz+, with everything in lanes of
 * functionals, and from what weighs states between the ends, which are sums of the same rates:
 *
 *     kappa_j = h (b_j lambda + sum_i>j a_ij nu_i),  nu_j = f_z(Y_j)^T kappa_j,  gradient += f_p(Y_j)^T kappa_j,
 *     lambda <- lambda + sum nu_j.
 *
 * The step sizes are constants of differentiation. */
#include "inside.h"

#include <string.h>

struct ordernm_adjoint {
    ordernm_problem problem;          /* the motion's, without directions */
    ordernm_results none;
    ordernm_gradients *gradients;
    ordernm_motion *motion;
    int width, index, ngroups;        /* functionals, so many at a time */
    int n;                            /* entries that are integrated and differentiated */
    long *sampled;                    /* times that are left, of each group */
    double *lambda;                   /* [ngroups][n][width] */
    double *kappa[MOST_STAGES], *nu;  /* [n][width] */
    double *stage[MOST_STAGES], *q[MOST_STAGES]; /* states, and coordinates with loops closed */
    double *weights_q, *weights_u, *dq, *du, *dp, *dinputs, *weights;
    double *p, *inputs;               /* [ngroups][np][width], [ngroups][count][ninputs][width] */
};

/* Lays an adjoint out; a is 0 where only the size is asked for. */
static size_t lay_out(ordernm_adjoint *a, const ordernm_problem *problem, ordernm_gradients *g)
{
    const ordernm_system *const s = problem->system;
    memory of = {(char *)a, 0};
    ordernm_adjoint none;
    ordernm_take(&of, sizeof none);
    if (!a) a = &none;
    memset(a, 0, sizeof *a);
    a->problem = *problem;
    a->problem.ndirections = 0;
    a->problem.atol_directions = 0;
    a->gradients = g;
    a->index = g->nfunctionals > 1;
    a->width = a->index ? LANES : 1;
    a->ngroups = (g->nfunctionals + a->width - 1)/a->width;
    a->n = s->nfree_q + s->nfree_u + problem->nintegrals;
    const long width = a->width, values = s->nq + s->nfree_u + problem->nintegrals;
    a->sampled = ordernm_take(&of, a->ngroups*sizeof(long));
    a->lambda = ordernm_numbers(&of, a->ngroups*a->n*width);
    a->nu = ordernm_numbers(&of, a->n*width);
    for (int i = 0; i < MOST_STAGES; ++i) {
        a->kappa[i] = ordernm_numbers(&of, a->n*width);
        a->stage[i] = ordernm_numbers(&of, values);
        a->q[i] = ordernm_numbers(&of, s->nq);
    }
    a->weights_q = ordernm_numbers(&of, s->nq*width);
    a->weights_u = ordernm_numbers(&of, s->nu*width);
    a->dq = ordernm_numbers(&of, s->nq*width);
    a->du = ordernm_numbers(&of, s->nu*width);
    a->dp = ordernm_numbers(&of, s->np*width);
    a->dinputs = ordernm_numbers(&of, s->ninputs*width);
    a->weights = ordernm_numbers(&of, s->noutputs*width);
    a->p = ordernm_numbers(&of, a->ngroups*s->np*width);
    a->inputs = ordernm_numbers(&of, a->ngroups*problem->inputs.count*s->ninputs*width);
    return of.used;
}

long ordernm_adjoint_room(const ordernm_problem *problem, const ordernm_gradients *gradients)
{
    ordernm_problem alone = *problem;
    alone.ndirections = 0;
    return 8 + (long)(lay_out(0, problem, (ordernm_gradients *)gradients)/sizeof(double)) + ordernm_room(&alone);
}

ordernm_adjoint *ordernm_adjoint_begin(const ordernm_problem *problem, ordernm_gradients *g, double *room)
{
    ordernm_adjoint *const a = ordernm_line(room);
    const size_t used = lay_out(0, problem, g);
    memset(a, 0, used);
    lay_out(a, problem, g);
    a->motion = ordernm_begin(&a->problem, (double *)((char *)a + used));
    a->motion->results = &a->none;
    for (int n = 0; n < a->ngroups; ++n) {
        a->sampled[n] = g->ntimes;
        double *const lambda = a->lambda + (long)n*a->n*a->width;
        const ordernm_system *const s = problem->system;
        for (int l = 0; l < a->width && n*a->width + l < g->nfunctionals; ++l) {
            const long f = n*a->width + l;
            for (int i = 0; g->end_q && i < s->nfree_q; ++i) lambda[i*a->width + l] = g->end_q[f*s->nq + s->free_q[i]];
            for (int i = 0; g->end_u && i < s->nfree_u; ++i)
                lambda[(s->nfree_q + i)*a->width + l] = g->end_u[f*s->nu + s->free_u[i]];
        }
        for (int i = 0; g->integral_weights && i < problem->nintegrals; ++i)
            for (int l = 0; l < a->width && n*a->width + l < g->nfunctionals; ++l)
                a->lambda[((long)n*a->n + a->motion->ny + i)*a->width + l] =
                    g->integral_weights[(long)(n*a->width + l)*problem->nintegrals + i];
    }
    return a;
}

/* ---- One state. ---- */

/* Adds what transposes gave, c->dq and so on, to an adjoint of the state and to the gradients of a group. */
static void add(ordernm_adjoint *a, int n, const ordernm_call *c, double t, double *nu)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const int width = a->width;
    for (int i = 0; i < s->nfree_q; ++i)
        for (int l = 0; l < width; ++l) nu[i*width + l] += c->dq[s->free_q[i]*width + l];
    for (int i = 0; i < s->nfree_u; ++i)
        for (int l = 0; l < width; ++l) nu[(s->nfree_q + i)*width + l] += c->du[s->free_u[i]*width + l];
    double *const p = a->p + (long)n*s->np*width;
    for (long i = 0; i < (long)s->np*width; ++i) p[i] += c->dp[i];
    if (!s->ninputs) return;
    const ordernm_inputs *const in = &m->problem->inputs;
    double value[4] = {1.0};
    const long first = in->knots ? ordernm_b_splines(m, t, value) : 0;
    for (int b = 0; b <= in->degree; ++b) {
        double *const row = a->inputs + ((long)n*in->count + first + b)*s->ninputs*width;
        for (int i = 0; i < s->ninputs*width; ++i) row[i] += value[b]*c->dinputs[i];
    }
}

/* Where transposes write; what a function does not know of stays zero. */
static void clear(ordernm_adjoint *a, ordernm_call *c)
{
    const ordernm_system *const s = a->motion->system;
    memset(a->dq, 0, s->nq*a->width*sizeof(double));
    memset(a->du, 0, s->nu*a->width*sizeof(double));
    memset(a->dp, 0, s->np*a->width*sizeof(double));
    memset(a->dinputs, 0, s->ninputs*a->width*sizeof(double));
    memset(c->dt, 0, a->width*sizeof(double));
    c->dq = a->dq, c->du = a->du, c->dp = a->dp, c->dinputs = a->dinputs;
}

static int any(const double *x, long n)
{
    for (long i = 0; i < n; ++i)
        if (x[i] != 0.0) return 1;
    return 0;
}

/* A state whose loops have been closed before. */
static ordernm_call closed(ordernm_adjoint *a, double t, const double *z, double *q)
{
    ordernm_call c = ordernm_arguments(a->motion, t, z);
    if (!a->motion->identity) c.q = q;
    return c;
}

/* nu = f_z^T kappa at a state, and the gradients' parts. */
static int transposed_rates(ordernm_adjoint *a, int n, double t, const double *z, double *q, const double *kappa, double *nu)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const ordernm_problem *const p = m->problem;
    const int width = a->width, index = a->index;
    const size_t entry = width*sizeof(double);
    ordernm_call c = closed(a, t, z, q);
    int status;
    ++a->gradients->transposes;
    memset(nu, 0, a->n*entry);
    c.qdot = m->qdot, c.udot = m->udot, c.outputs = m->outputs;
    for (int i = 0; i < s->nfree_u; ++i)
        memcpy(a->weights_u + s->free_u[i]*width, kappa + (s->nfree_q + i)*width, entry);
    clear(a, &c);
    c.dudot = a->weights_u;
    if ((status = s->sensitivities_transposed[index](&c))) return status;
    add(a, n, &c, t, nu);
    if (s->plain_rates) {
        for (int i = 0; i < s->nfree_q; ++i)
            for (int l = 0; l < width; ++l) nu[(s->nfree_q + i)*width + l] += kappa[i*width + l];
    } else {
        for (int i = 0; i < s->nfree_q; ++i) memcpy(a->weights_q + s->free_q[i]*width, kappa + i*width, entry);
        clear(a, &c);
        c.dqdot = a->weights_q;
        if ((status = s->coordinate_rate_sensitivities_transposed[index](&c))) return status;
        add(a, n, &c, t, nu);
    }
    if (m->nx && any(kappa + m->ny*width, m->nx*width)) {
        memset(a->weights, 0, s->noutputs*entry);
        for (int i = 0; i < m->nx; ++i)
            for (int l = 0; l < width; ++l) a->weights[p->integrals[i]*width + l] += kappa[(m->ny + i)*width + l];
        clear(a, &c);
        c.doutputs = a->weights;
        if ((status = s->output_sensitivities_transposed[index](&c))) return status;
        add(a, n, &c, t, nu);
    }
    return 0;
}

/* The adjoint of a state from the weights of its outputs. */
static int sampled(ordernm_adjoint *a, int n, long time, double t, const double *z, double *nu)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const ordernm_gradients *const g = a->gradients;
    const int width = a->width;
    memset(nu, 0, a->n*width*sizeof(double));
    if (!g->weights) return 0;
    for (int i = 0; i < s->noutputs; ++i)
        for (int l = 0; l < width; ++l) {
            const int functional = n*width + l;
            a->weights[i*width + l] =
                functional < g->nfunctionals ? g->weights[((long)functional*g->ntimes + time)*s->noutputs + i] : 0.0;
        }
    if (!any(a->weights, s->noutputs*width)) return 0;
    ordernm_call c = ordernm_arguments(m, t, z);
    int status = ordernm_close_loops(m, &c);
    if (status) return status;
    clear(a, &c);
    c.outputs = m->outputs;
    c.doutputs = a->weights;
    if ((status = s->output_sensitivities_transposed[a->index](&c))) return status;
    add(a, n, &c, t, nu);
    return 0;
}

/* The transpose of what is done between steps to joints with independent and dependent speeds. */
static int transposed_settling(ordernm_adjoint *a, int n, double t, const double *z, double *lambda)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const int width = a->width;
    if (!s->split) return 0;
    ordernm_call c = ordernm_arguments(m, t, z);
    int status = ordernm_close_loops(m, &c);
    if (status) return status;
    clear(a, &c);
    c.full_u = m->udot;
    memset(a->weights_q, 0, s->nq*width*sizeof(double));
    for (int i = 0; i < s->nfree_q; ++i)
        memcpy(a->weights_q + s->free_q[i]*width, lambda + i*width, width*sizeof(double));
    memset(a->weights_u, 0, s->nu*width*sizeof(double));
    c.dfull_q = a->weights_q, c.dfull_u = a->weights_u;
    if ((status = s->completion_sensitivities_transposed[a->index](&c))) return status;
    memset(lambda, 0, s->nfree_q*width*sizeof(double));
    add(a, n, &c, t, lambda);
    memset(a->weights_q, 0, s->nq*width*sizeof(double));
    return 0;
}

/* ---- One step. ---- */

/* The stages of a step, as they were, and their rates: where something else than the step's end is a sum of them. */
static int stages(ordernm_adjoint *a, double h, int count)
{
    ordernm_motion *const m = a->motion;
    const method *const method = m->method;
    for (int i = 0; i < count; ++i) {
        const row *const r = method->rows + i;
        ordernm_combine(m->values, a->stage[i], m->z, h, r->count, r->which, r->factor, m->rate);
        const double t = m->t + method->times[i]*h;
        const int status = ordernm_rates(m, t, a->stage[i], m->rate[i]);
        ++a->gradients->evaluations;
        if (status) return status;
        if (!m->identity) memcpy(a->q[i], m->q, m->system->nq*sizeof(double));
    }
    return 0;
}

static void accumulate(double *to, double factor, const double *of, long n)
{
    for (long i = 0; i < n; ++i) to[i] += factor*of[i];
}

/* The same from a row of steps. */
static void stages_kept(ordernm_adjoint *a, const double *step)
{
    ordernm_motion *const m = a->motion;
    const long state = m->ny + m->nx + m->nd, nq = m->identity ? 0 : m->system->nq;
    const double *at = step + 2 + state;
    memcpy(a->stage[0], m->z, state*sizeof(double));
    memcpy(a->q[0], m->q, nq*sizeof(double));
    for (int i = 1; i < m->method->stages; ++i, at += state + nq) {
        memcpy(a->stage[i], at, state*sizeof(double));
        memcpy(a->q[i], at + state, nq*sizeof(double));
    }
}

/* One group of functionals through one step: lambda at its end becomes lambda at its beginning. */
static int group_backwards(ordernm_adjoint *a, int n, double h, int within)
{
    ordernm_motion *const m = a->motion;
    const method *const method = m->method;
    const ordernm_gradients *const g = a->gradients;
    const long size = (long)a->n*a->width;
    double *const lambda = a->lambda + n*size;
    const row *const end = method->rows + method->stages;
    const int count = within ? method->all : method->stages;
    int status;
    for (int i = 0; i < count; ++i) memset(a->kappa[i], 0, size*sizeof(double));
    for (int j = 0; j < end->count; ++j) accumulate(a->kappa[end->which[j]], h*end->factor[j], lambda, size);
    while (a->sampled[n] > 0 && g->times[a->sampled[n] - 1] > m->t) {
        const long time = --a->sampled[n];
        const double theta = (g->times[time] - m->t)/h;
        double factor[MOST_STAGES];
        static const int every[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
        method->weights(theta, factor);
        ordernm_combine(m->values, m->trial, m->z, h, method->all, every, factor, m->rate);
        if ((status = sampled(a, n, time, g->times[time], m->trial, a->nu))) return status;
        accumulate(lambda, 1.0, a->nu, size);
        for (int j = 0; j < method->all; ++j) accumulate(a->kappa[j], h*factor[j], a->nu, size);
    }
    for (int i = count - 1; i >= 0; --i) {
        if (!any(a->kappa[i], size)) continue;
        const row *const r = method->rows + i;
        const double t = m->t + method->times[i]*h;
        if ((status = transposed_rates(a, n, t, a->stage[i], a->q[i], a->kappa[i], a->nu))) return status;
        accumulate(lambda, 1.0, a->nu, size);
        for (int j = 0; j < r->count; ++j) accumulate(a->kappa[r->which[j]], h*r->factor[j], a->nu, size);
    }
    return 0;
}

int ordernm_backwards(ordernm_adjoint *a, const double *steps, long count)
{
    ordernm_motion *const m = a->motion;
    const ordernm_gradients *const g = a->gradients;
    const long size = ordernm_step_size(m->problem);
    for (long k = count - 1; k >= 0; --k) {
        const double *const step = steps + k*size;
        const double h = step[1], end = step[0] + h;
        int status;
        m->t = step[0];
        memcpy(m->z, step + 2, (m->ny + m->nx + m->nd)*sizeof(double));
        ordernm_find_segment(m, m->t, h);
        int within = 0;
        for (int n = 0; n < a->ngroups; ++n) {
            const long left = a->sampled[n];
            within |= left && g->times[left - 1] > m->t;
        }
        if (within || m->system->split) {
            if ((status = stages(a, h, within ? m->method->all : m->method->stages))) goto failed;
        } else {
            ordernm_arguments(m, m->t, m->z); /* of the first stage, whose loops are closed between steps */
            stages_kept(a, step);
        }
        if (m->system->split) {
            const row *const r = m->method->rows + m->method->stages;
            ordernm_combine(m->values, m->next, m->z, h, r->count, r->which, r->factor, m->rate);
            for (int n = 0; n < a->ngroups; ++n) {
                double *const lambda = a->lambda + (long)n*a->n*a->width;
                if ((status = transposed_settling(a, n, end, m->next, lambda))) goto failed;
            }
        }
        for (int n = 0; n < a->ngroups; ++n)
            if ((status = group_backwards(a, n, h, within))) goto failed;
        continue;
    failed:
        a->gradients->singular = status;
        return status < 0 ? ORDERNM_OPEN : ORDERNM_SINGULAR;
    }
    return ORDERNM_ENDED;
}

/* Gradients from their lanes; weights at the very beginning are taken too. */
void ordernm_adjoint_end(ordernm_adjoint *a)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const ordernm_gradients *const g = a->gradients;
    const int width = a->width;
    const long count = m->problem->inputs.count*s->ninputs;
    for (int n = 0; n < a->ngroups; ++n) {
        double *const lambda = a->lambda + (long)n*a->n*width;
        while (a->sampled[n] > 0) {
            const long time = --a->sampled[n];
            if (!sampled(a, n, time, g->times[time], m->z, a->nu)) accumulate(lambda, 1.0, a->nu, (long)a->n*width);
        }
        transposed_settling(a, n, m->t, m->z, lambda); /* the initial state is settled too */
        for (int l = 0; l < width && n*width + l < g->nfunctionals; ++l) {
            const long f = n*width + l;
            for (int i = 0; i < s->nfree_q; ++i) g->q[f*s->nq + s->free_q[i]] += lambda[i*width + l];
            for (int i = 0; i < s->nfree_u; ++i) g->u[f*s->nu + s->free_u[i]] += lambda[(s->nfree_q + i)*width + l];
            for (int i = 0; i < s->np; ++i) g->p[f*s->np + i] += a->p[((long)n*s->np + i)*width + l];
            for (long i = 0; i < count; ++i) g->inputs[f*count + i] += a->inputs[(n*count + i)*width + l];
        }
    }
}

/* ---- Steps that were not kept, again. ---- */

int ordernm_replay(ordernm_motion *m, double *steps, long count)
{
    const long size = ordernm_step_size(m->problem);
    const method *const method = m->method;
    const row *const end = method->rows + method->stages;
    ordernm_results none = {.steps = steps};
    m->results = &none;
    memcpy(m->z, steps + 2, (m->ny + m->nx + m->nd)*sizeof(double));
    for (long k = 0; k < count; ++k) {
        double *const step = steps + k*size;
        const double h = step[1];
        m->t = step[0];
        memcpy(step + 2, m->z, (m->ny + m->nx + m->nd)*sizeof(double));
        ordernm_find_segment(m, m->t, h);
        for (int i = 0; i < method->stages; ++i) {
            const row *const r = method->rows + i;
            ordernm_combine(m->size, m->trial, m->z, h, r->count, r->which, r->factor, m->rate);
            if (ordernm_rates(m, m->t + method->times[i]*h, m->trial, m->rate[i])) return ORDERNM_SINGULAR;
            if (i) ordernm_keep_stage(m, i);
        }
        memcpy(step + 2 + m->ny + m->nx + m->nd, m->stages, (size - 2 - (m->ny + m->nx + m->nd))*sizeof(double));
        ordernm_combine(m->size, m->next, m->z, h, end->count, end->which, end->factor, m->rate);
        double *const before = m->z;
        m->z = m->next;
        m->next = before;
        if (ordernm_settle(m, m->t + h, m->z) < 0) return ORDERNM_OPEN;
    }
    return ORDERNM_ENDED;
}
