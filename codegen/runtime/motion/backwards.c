/* The discrete adjoint: every step of a motion backwards, what is done between steps, and the gradients in the end.
 *
 * The step sizes are constants of differentiation. */
#include "backwards.h"

#include <string.h>

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
    a->index = g->nfunctionals > 1 ? ORDERNM_EIGHT : 0;
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
    a->next = ordernm_numbers(&of, s->nswitches ? values : 0);
    a->next_modes = ordernm_numbers(&of, 2*s->nswitches);
    a->p = ordernm_numbers(&of, a->ngroups*s->np*width);
    a->inputs = ordernm_numbers(&of, a->ngroups*problem->inputs.count*ordernm_signals(s)*width);
    if (problem->method == ORDERNM_RADAU && s->nfree_q + s->nfree_u)
        a->of_stages = ordernm_take(&of, ordernm_radau_layout_stages(0, s->nfree_q + s->nfree_u, 0));
    return of.used;
}

long ordernm_adjoint_room(const ordernm_problem *problem, const ordernm_gradients *gradients)
{
    ordernm_problem alone = *problem;
    alone.ndirections = 0;
    return 8 + (long)(lay_out(0, problem, (ordernm_gradients *)gradients)/sizeof(double)) + ordernm_room(&alone);
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
    double value[ORDERNM_ORDERS][ORDERNM_MOST_DEGREE + 1];
    const long first = ordernm_input_weights(m, t, value);
    for (int i = 0; i < s->ninputs; ++i) {
        int order;
        const int signal = ordernm_signal_of(s, i, &order);
        for (int b = 0; b <= in->degree; ++b) {
            double *const entry = a->inputs + (((long)n*in->count + first + b)*ordernm_signals(s) + signal)*width;
            for (int l = 0; l < width; ++l) entry[l] += value[order][b]*c->dinputs[i*width + l];
        }
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

/* A state whose loops have been closed before. */
static void closed(ordernm_adjoint *a, double t, const double *z, double *q, ordernm_call *c)
{
    ordernm_arguments(a->motion, t, z, c);
    if (!a->motion->identity) c->q = q;
}

/* nu = f_z^T kappa at a state, and the gradients' parts; of independent coordinates and speeds. */
int ordernm_rates_transposed(ordernm_adjoint *a, int n, double t, const double *z, double *q, const double *kappa, double *nu)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const int width = a->width, index = a->index;
    const size_t entry = width*sizeof(double);
    ordernm_call c;
    closed(a, t, z, q, &c);
    int status;
    ++a->gradients->transposes;
    memset(nu, 0, a->n*entry);
    c.qdot = m->qdot, c.udot = m->udot, c.outputs = m->outputs;
    for (int i = 0; i < s->nfree_u; ++i)
        memcpy(a->weights_u + s->free_u[i]*width, kappa + (s->nfree_q + i)*width, entry);
    clear(a, &c);
    c.dudot = a->weights_u;
    if ((status = ORDERNM_OF(m, sensitivities_transposed[index])(&c))) return status;
    add(a, n, &c, t, nu);
    if (s->plain_rates) {
        for (int i = 0; i < s->nfree_q; ++i)
            for (int l = 0; l < width; ++l) nu[(s->nfree_q + i)*width + l] += kappa[i*width + l];
    } else {
        for (int i = 0; i < s->nfree_q; ++i) memcpy(a->weights_q + s->free_q[i]*width, kappa + i*width, entry);
        clear(a, &c);
        c.dqdot = a->weights_q;
        if ((status = ORDERNM_OF(m, coordinate_rate_sensitivities_transposed[index])(&c))) return status;
        add(a, n, &c, t, nu);
    }
    return 0;
}

/* Adds to nu what the rates of integrals, weighed by those entries of kappa, depend on at a state. */
int ordernm_integrals_transposed(ordernm_adjoint *a, int n, double t, const double *z, double *q, const double *kappa, double *nu)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const int width = a->width;
    if (!m->nx || !ordernm_any(kappa + m->ny*width, m->nx*width)) return 0;
    ordernm_call c;
    closed(a, t, z, q, &c);
    memset(a->weights, 0, s->noutputs*width*sizeof(double));
    for (int i = 0; i < m->nx; ++i)
        for (int l = 0; l < width; ++l) a->weights[m->problem->integrals[i]*width + l] += kappa[(m->ny + i)*width + l];
    clear(a, &c);
    c.outputs = m->outputs;
    c.doutputs = a->weights;
    const int status = ORDERNM_OF(m, output_sensitivities_transposed[a->index])(&c);
    if (!status) add(a, n, &c, t, nu);
    return status;
}

/* The adjoint of a state from weights of its outputs, of a group of functionals, [nfunctionals][ntimes][noutputs], at one time. */
static int outputs_transposed(ordernm_adjoint *a, int n, double t, const double *z, const double *weights, long ntimes, long time,
    double *nu)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const int width = a->width;
    memset(nu, 0, a->n*width*sizeof(double));
    if (!weights) return 0;
    for (int i = 0; i < s->noutputs; ++i)
        for (int l = 0; l < width; ++l) {
            const int functional = n*width + l;
            a->weights[i*width + l] =
                functional < a->gradients->nfunctionals ? weights[((long)functional*ntimes + time)*s->noutputs + i] : 0.0;
        }
    if (!ordernm_any(a->weights, s->noutputs*width)) return 0;
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    int status = ordernm_close_loops(m, &c);
    if (status) return status;
    clear(a, &c);
    c.outputs = m->outputs;
    c.doutputs = a->weights;
    if ((status = ORDERNM_OF(m, output_sensitivities_transposed[a->index])(&c))) return status;
    add(a, n, &c, t, nu);
    return 0;
}

/* The same at the last time that is left. */
int ordernm_sample_transposed(ordernm_adjoint *a, int n, double t, const double *z, double *nu)
{
    const ordernm_gradients *const g = a->gradients;
    return outputs_transposed(a, n, t, z, g->weights, g->ntimes, --a->sampled[n], nu);
}

/* Adds what is weighed behind a jump where the step at hand begins. */
static int sample_behind(ordernm_adjoint *a)
{
    const ordernm_motion *const m = a->motion;
    const ordernm_gradients *const g = a->gradients;
    const long size = (long)a->n*a->width;
    while (a->behind > 0 && g->behind[a->behind - 1] >= m->t) {
        a->timed = --a->behind;
        for (int n = 0; n < a->ngroups; ++n) {
            const int status = outputs_transposed(a, n, m->t, m->z, g->behind_weights, g->nbehind, a->timed, a->nu);
            if (status) return status;
            ordernm_accumulate(a->lambda + n*size, 1.0, a->nu, size);
        }
    }
    return 0;
}

/* The adjoint of a group before a switch where rates jump by -`jump`, whose switching function changes at a speed. */
int ordernm_switch_transposed(ordernm_adjoint *a, int n, double t, const double *z, int k, const double *jump, double speed,
    int timed)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const ordernm_gradients *const of = a->gradients;
    const int width = a->width;
    double *const lambda = a->lambda + (long)n*a->n*width;
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    int status = ordernm_close_loops(m, &c);
    if (status) return status;
    memset(m->dswitches, 0, s->nswitches*width*sizeof(double));
    for (int i = 0; i < a->n; ++i)
        for (int l = 0; l < width; ++l) m->dswitches[k*width + l] -= lambda[i*width + l]*jump[i]/speed;
    for (int l = 0; timed && l < width && n*width + l < of->nfunctionals; ++l)
        m->dswitches[k*width + l] -= of->time_weights[(n*width + l)*of->nbehind + a->timed]/speed;
    clear(a, &c);
    c.switches = m->switches;
    c.dswitches = m->dswitches;
    status = ORDERNM_OF(m, switch_sensitivities_transposed[a->index])(&c);
    if (!status) add(a, n, &c, t, lambda);
    return status;
}

/* The transpose of what is done between steps to joints with independent and dependent speeds. */
static int transposed_settling(ordernm_adjoint *a, int n, double t, const double *z, double *lambda)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const int width = a->width;
    if (!s->split) return 0;
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    int status = ordernm_close_loops(m, &c);
    if (status) return status;
    clear(a, &c);
    c.full_u = m->udot;
    memset(a->weights_q, 0, s->nq*width*sizeof(double));
    for (int i = 0; i < s->nfree_q; ++i)
        memcpy(a->weights_q + s->free_q[i]*width, lambda + i*width, width*sizeof(double));
    memset(a->weights_u, 0, s->nu*width*sizeof(double));
    c.dfull_q = a->weights_q, c.dfull_u = a->weights_u;
    if ((status = ORDERNM_OF(m, completion_sensitivities_transposed[a->index])(&c))) return status;
    memset(lambda, 0, s->nfree_q*width*sizeof(double));
    add(a, n, &c, t, lambda);
    memset(a->weights_q, 0, s->nq*width*sizeof(double));
    return 0;
}

int ordernm_settling_transposed(ordernm_adjoint *a, double t, const double *z)
{
    int status = 0;
    for (int n = 0; n < a->ngroups && !status; ++n)
        status = transposed_settling(a, n, t, z, a->lambda + (long)n*a->n*a->width);
    return status;
}

/* Of weights of all entries of the state at the end, which was completed there, those of its independent entries. */
static int transposed_completion(ordernm_adjoint *a, int n, double *lambda)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const ordernm_gradients *const g = a->gradients;
    const int width = a->width;
    ordernm_call c;
    ordernm_arguments(m, m->t, m->z, &c);
    c.q = g->whole_q, c.u = g->whole_u;
    clear(a, &c);
    for (int l = 0; l < width; ++l) {
        const long f = (long)n*width + l;
        for (int i = 0; i < s->nq; ++i) a->weights_q[i*width + l] = f < g->nfunctionals ? g->end_q[f*s->nq + i] : 0.0;
        for (int i = 0; i < s->nu; ++i) a->weights_u[i*width + l] = f < g->nfunctionals ? g->end_u[f*s->nu + i] : 0.0;
    }
    c.full_u = m->udot;
    c.dfull_q = a->weights_q, c.dfull_u = a->weights_u;
    m->precise = s->precise != 0; /* conditions are poor where independents change */
    const int status = ORDERNM_OF(m, completion_sensitivities_transposed[a->index])(&c);
    if (!status) add(a, n, &c, m->t, lambda);
    memset(a->weights_q, 0, s->nq*width*sizeof(double));
    memset(a->weights_u, 0, s->nu*width*sizeof(double));
    return status;
}

/* ---- From the end to the beginning. ---- */

ordernm_adjoint *ordernm_adjoint_begin(const ordernm_problem *problem, ordernm_gradients *g, double *room)
{
    ordernm_adjoint *const a = ordernm_line(room);
    const size_t used = lay_out(0, problem, g);
    memset(a, 0, used);
    lay_out(a, problem, g);
    a->motion = ordernm_begin(&a->problem, (double *)((char *)a + used));
    a->motion->results = &a->none;
    if (a->of_stages) ordernm_radau_layout_stages(a->motion, a->motion->ny, a->of_stages);
    a->behind = g->nbehind;
    a->timed = -1;
    for (int n = 0; n < a->ngroups; ++n) {
        a->sampled[n] = g->ntimes;
        double *const lambda = a->lambda + (long)n*a->n*a->width;
        const ordernm_system *const s = problem->system;
        for (int l = 0; l < a->width && n*a->width + l < g->nfunctionals && !g->whole_q; ++l) {
            const long f = n*a->width + l;
            for (int i = 0; g->end_q && i < s->nfree_q; ++i) lambda[i*a->width + l] = g->end_q[f*s->nq + s->free_q[i]];
            for (int i = 0; g->end_u && i < s->nfree_u; ++i)
                lambda[(s->nfree_q + i)*a->width + l] = g->end_u[f*s->nu + s->free_u[i]];
        }
        for (int i = 0; g->integral_weights && i < problem->nintegrals; ++i)
            for (int l = 0; l < a->width && n*a->width + l < g->nfunctionals; ++l)
                a->lambda[((long)n*a->n + a->motion->ny + i)*a->width + l] =
                    g->integral_weights[(long)(n*a->width + l)*problem->nintegrals + i];
        if (g->whole_q && !g->singular) g->singular = transposed_completion(a, n, lambda);
    }
    return a;
}

int ordernm_backwards(ordernm_adjoint *a, const double *steps, long count)
{
    ordernm_motion *const m = a->motion;
    const long size = ordernm_step_size(m->problem);
    for (long k = count - 1; k >= 0; --k) {
        const double *const step = steps + k*size;
        m->t = step[0];
        memcpy(m->z, step + m->head, (m->ny + m->nx + m->nd)*sizeof(double));
        ordernm_find_segment(m, m->t, step[1]);
        ordernm_take_derivatives(m, step[4]);
        ordernm_take_modes(m, step + ORDERNM_STEP_HEAD);
        int status = a->has_next ? ordernm_switches_transposed(a, a->next_t, a->next, a->next_modes) : 0;
        if (!status && step[1] > 0.0) status = m->method->backwards(a, step);
        if (!status) status = sample_behind(a);
        if (m->nheld) {
            a->has_next = 1;
            a->next_t = m->t;
            memcpy(a->next, m->z, (m->ny + m->nx + m->nd)*sizeof(double));
            memcpy(a->next_modes, step + ORDERNM_STEP_HEAD, 2*m->system->nswitches*sizeof(double));
        }
        if (!status) continue;
        a->gradients->singular = status;
        return status < -1 ? ORDERNM_COLLAPSED : status < 0 ? ORDERNM_OPEN : ORDERNM_SINGULAR;
    }
    return ORDERNM_ENDED;
}

/* Gradients from their lanes; weights at the very beginning are taken too. */
void ordernm_adjoint_end(ordernm_adjoint *a)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    ordernm_gradients *const g = a->gradients;
    const int width = a->width;
    const long count = m->problem->inputs.count*ordernm_signals(s);
    for (int n = 0; n < a->ngroups; ++n) {
        double *const lambda = a->lambda + (long)n*a->n*width;
        while (a->sampled[n] > 0) {
            const double t = g->times[a->sampled[n] - 1];
            if (!ordernm_sample_transposed(a, n, t, m->z, a->nu)) ordernm_accumulate(lambda, 1.0, a->nu, (long)a->n*width);
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
    g->evaluations += a->none.evaluations;
}

/* ---- Steps that were not kept, again. ---- */

int ordernm_replay(ordernm_motion *m, const double *known, double *steps, long count)
{
    const long size = ordernm_step_size(m->problem);
    const size_t state = (m->ny + m->nx + m->nd)*sizeof(double);
    int status;
    ordernm_results none = {.steps = steps};
    m->results = &none;
    memcpy(m->z, steps + m->head, state);
    ordernm_take_modes(m, steps + ORDERNM_STEP_HEAD);
    for (long k = 0; k < count; ++k) {
        double *const step = steps + k*size;
        m->t = step[0];
        memcpy(step + m->head, m->z, state);
        ordernm_find_segment(m, m->t, step[1]);
        ordernm_take_derivatives(m, step[4]);
        if (step[1] == 0.0) break; /* the end, behind an event */
        if (m->method->replay(m, k ? 0 : known, !k, step)) return ORDERNM_SINGULAR;
        m->method->keep(m, step);
        if (k + 1 == count) break;
        const double end = step[size], knot = ordernm_next_knot(m, m->t);
        m->closed_known = 0;
        if (!m->method->gives_rate && ordernm_rates_at_end(m, end, m->rate[m->method->stages])) return ORDERNM_SINGULAR;
        if ((status = ordernm_next_step(m, end, knot, 0, step + size + ORDERNM_STEP_HEAD))) return status < 0 ? ORDERNM_OPEN : ORDERNM_SINGULAR;
    }
    return ORDERNM_ENDED;
}
