/* The adjoint of one state: transposes of its rates, outputs, switches, and of the adjustments between steps. */
#include "backwards.h"

#include <string.h>

/* Adds the results of transposed functions, such as c->dq, to an adjoint of the state and to the gradients of a group. */
static void add(ordernm_adjoint *a, int n, const ordernm_call *c, scalar t, scalar *nu)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const int width = a->width;
    for (int i = 0; i < s->nfree_q; ++i)
        for (int l = 0; l < width; ++l) nu[i*width + l] += c->dq[s->free_q[i]*width + l];
    for (int i = 0; i < s->nfree_u; ++i)
        for (int l = 0; l < width; ++l) nu[(s->nfree_q + i)*width + l] += c->du[s->free_u[i]*width + l];
    scalar *const p = a->p + (long)n*s->np*width;
    for (long i = 0; i < (long)s->np*width; ++i) p[i] += c->dp[i];
    if (!s->ninputs) return;
    const ordernm_inputs *const in = &m->problem->inputs;
    scalar value[ORDERNM_ORDERS][ORDERNM_MOST_DEGREE + 1];
    const long first = ordernm_input_weights(m, t, 0, value);
    for (int i = 0; i < s->ninputs; ++i) {
        int order;
        const int signal = ordernm_signal_of(s, i, &order);
        for (int b = 0; b <= in->degree; ++b) {
            scalar *const entry = a->inputs + (((long)n*in->count + first + b)*ordernm_signals(s) + signal)*width;
            for (int l = 0; l < width; ++l) entry[l] += value[order][b]*c->dinputs[i*width + l];
        }
    }
}

/* Clears the memory for results of transposes, because functions do not set all entries. */
static void clear(ordernm_adjoint *a, ordernm_call *c)
{
    const ordernm_system *const s = a->motion->system;
    memset(a->dq, 0, s->nq*a->width*sizeof(scalar));
    memset(a->du, 0, s->nu*a->width*sizeof(scalar));
    memset(a->dp, 0, s->np*a->width*sizeof(scalar));
    memset(a->dinputs, 0, s->ninputs*a->width*sizeof(scalar));
    memset(c->dt, 0, a->width*sizeof(scalar));
    c->dq = a->dq, c->du = a->du, c->dp = a->dp, c->dinputs = a->dinputs;
}

/* Arguments at a state whose loops were closed before; q contains its coordinates. */
static void closed(ordernm_adjoint *a, scalar t, const scalar *z, scalar *q, ordernm_call *c)
{
    ordernm_arguments(a->motion, t, z, c);
    if (!a->motion->identity) c->q = q;
}

/* nu = f_z^T kappa at a state, for independent coordinates and speeds; adds the contributions to gradients. */
int ordernm_rates_transposed(ordernm_adjoint *a, int n, scalar t, const scalar *z, scalar *q, const scalar *kappa, scalar *nu)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const int width = a->width, index = a->index;
    const size_t entry = width*sizeof(scalar);
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

/* Adds to nu the derivatives of the rates of integrals at a state, weighted by the corresponding entries of kappa. */
int ordernm_integrals_transposed(ordernm_adjoint *a, int n, scalar t, const scalar *z, scalar *q, const scalar *kappa, scalar *nu)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const int width = a->width;
    if (!m->nx || !ordernm_any(kappa + m->ny*width, m->nx*width)) return 0;
    ordernm_call c;
    closed(a, t, z, q, &c);
    memset(a->weights, 0, s->noutputs*width*sizeof(scalar));
    for (int i = 0; i < m->nx; ++i)
        for (int l = 0; l < width; ++l) a->weights[m->problem->integrals[i]*width + l] += kappa[(m->ny + i)*width + l];
    clear(a, &c);
    c.outputs = m->outputs;
    c.doutputs = a->weights;
    const int status = ORDERNM_OF(m, output_sensitivities_transposed[a->index])(&c);
    if (!status) add(a, n, &c, t, nu);
    return status;
}

/* Adds to nu the contribution of weighted outputs at one time, for a group of functionals. Weights are [nfunctionals][ntimes][noutputs]. */
static int outputs_transposed(ordernm_adjoint *a, int n, ordernm_call *c, const scalar *weights, long ntimes, long time, scalar *nu)
{
    ordernm_motion *const m = a->motion;
    const int width = a->width, noutputs = m->system->noutputs;
    for (int l = 0; l < width; ++l) {
        const long f = (long)n*width + l;
        for (int i = 0; i < noutputs; ++i)
            a->weights[i*width + l] = f < a->gradients->nfunctionals ? weights[(f*ntimes + time)*noutputs + i] : 0.0;
    }
    if (!ordernm_any(a->weights, noutputs*width)) return 0;
    clear(a, c);
    c->outputs = m->outputs;
    c->doutputs = a->weights;
    const int status = ORDERNM_OF(m, output_sensitivities_transposed[a->index])(c);
    if (!status) add(a, n, c, c->t, nu);
    return status;
}

/* Copies weights of all coordinates and speeds to lanes, for a group of functionals; element i of functional f is at f*stride + i. */
static void take_weights(ordernm_adjoint *a, int n, const scalar *of_q, const scalar *of_u, long stride_q, long stride_u)
{
    const ordernm_system *const s = a->motion->system;
    const int width = a->width;
    for (int l = 0; l < width; ++l) {
        const long f = (long)n*width + l;
        const int used = f < a->gradients->nfunctionals;
        for (int i = 0; i < s->nq; ++i) a->weights_q[i*width + l] = used ? of_q[f*stride_q + i] : 0.0;
        for (int i = 0; i < s->nu; ++i) a->weights_u[i*width + l] = used ? of_u[f*stride_u + i] : 0.0;
    }
}

/* Adds to nu the contribution of weighted coordinates and speeds, dependent ones included, at a state with closed loops. Sets the weights
 * to zero. */
static int completion_transposed(ordernm_adjoint *a, int n, ordernm_call *c, scalar *nu)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const int width = a->width;
    int status = 0;
    if (m->identity) {
        ordernm_accumulate(nu, 1.0, a->weights_q, (long)s->nq*width);
        ordernm_accumulate(nu + (long)s->nq*width, 1.0, a->weights_u, (long)s->nu*width);
    } else {
        clear(a, c);
        c->full_u = m->udot; /* memory */
        c->dfull_q = a->weights_q, c->dfull_u = a->weights_u;
        status = ORDERNM_OF(m, completion_sensitivities_transposed[a->index])(c);
        if (!status) add(a, n, c, c->t, nu);
    }
    memset(a->weights_q, 0, s->nq*width*sizeof(scalar));
    memset(a->weights_u, 0, s->nu*width*sizeof(scalar));
    return status;
}

/* Adds to nu the contribution of weighted states at one time; the results of a motion have normalised quaternions. */
static int states_transposed(ordernm_adjoint *a, int n, ordernm_call *c, const scalar *weights, long ntimes, long time, scalar *nu)
{
    const ordernm_system *const s = a->motion->system;
    const int width = a->width;
    const long size = s->nq + s->nu;
    take_weights(a, n, weights + time*size, weights + time*size + s->nq, ntimes*size, ntimes*size);
    if (!ordernm_any(a->weights_q, s->nq*width) && !ordernm_any(a->weights_u, s->nu*width)) return 0;
    for (int i = 0; i < s->nquaternions; ++i) {
        scalar e[4];
        memcpy(e, c->q + s->quaternion[i], sizeof e);
        ordernm_normalise(e, a->weights_q + s->quaternion[i]*width, width); /* this derivative is a symmetric matrix */
    }
    return completion_transposed(a, n, c, nu);
}

/* The adjoint of a state from weights of its outputs, and of its entries unless `states` is 0, at one of `ntimes` times. */
static int results_transposed(ordernm_adjoint *a, int n, scalar t, const scalar *z, const scalar *outputs, const scalar *states,
    long ntimes, long time, scalar *nu)
{
    ordernm_motion *const m = a->motion;
    memset(nu, 0, a->n*a->width*sizeof(scalar));
    if (!outputs && !states) return 0;
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    int status = ordernm_close_loops(m, &c);
    if (!status && states) status = states_transposed(a, n, &c, states, ntimes, time, nu);
    if (!status && outputs) status = outputs_transposed(a, n, &c, outputs, ntimes, time, nu);
    return status;
}

/* Adds the transposed derivatives of weighted results at the last remaining output time. */
int ordernm_sample_transposed(ordernm_adjoint *a, int n, scalar t, const scalar *z, scalar *nu)
{
    const ordernm_gradients *const g = a->gradients;
    return results_transposed(a, n, t, z, g->weights, g->state_weights, g->ntimes, --a->sampled[n], nu);
}

/* Adds the contributions of weighted outputs just after a jump at the start of the current step. */
int ordernm_sample_behind(ordernm_adjoint *a)
{
    const ordernm_motion *const m = a->motion;
    const ordernm_gradients *const g = a->gradients;
    const long size = (long)a->n*a->width;
    while (a->behind > 0 && g->behind[a->behind - 1] >= m->t) {
        a->timed = --a->behind;
        for (int n = 0; n < a->ngroups; ++n) {
            const int status = results_transposed(a, n, m->t, m->z, g->behind_weights, 0, g->nbehind, a->timed, a->nu);
            if (status) return status;
            ordernm_accumulate(a->lambda + n*size, 1.0, a->nu, size);
        }
    }
    return 0;
}

/* The adjoint of a group before a switch where rates jump by -`jump`, with the rate `speed` of its switching function. `timed`: functionals
 * also depend on the time of the switch. */
int ordernm_switch_transposed(ordernm_adjoint *a, int n, scalar t, const scalar *z, int k, const scalar *jump, scalar speed,
    int timed)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const ordernm_gradients *const of = a->gradients;
    const int width = a->width;
    scalar *const lambda = a->lambda + (long)n*a->n*width;
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    int status = ordernm_close_loops(m, &c);
    if (status) return status;
    memset(m->dswitches, 0, s->nswitches*width*sizeof(scalar));
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

/* The transpose of the adjustments between steps, for joints with both independent and dependent speeds. */
static int transposed_settling(ordernm_adjoint *a, int n, scalar t, const scalar *z, scalar *lambda)
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
    memset(a->weights_q, 0, s->nq*width*sizeof(scalar));
    for (int i = 0; i < s->nfree_q; ++i)
        memcpy(a->weights_q + s->free_q[i]*width, lambda + i*width, width*sizeof(scalar));
    memset(a->weights_u, 0, s->nu*width*sizeof(scalar));
    c.dfull_q = a->weights_q, c.dfull_u = a->weights_u;
    if ((status = ORDERNM_OF(m, completion_sensitivities_transposed[a->index])(&c))) return status;
    memset(lambda, 0, s->nfree_q*width*sizeof(scalar));
    add(a, n, &c, t, lambda);
    memset(a->weights_q, 0, s->nq*width*sizeof(scalar));
    return 0;
}

int ordernm_settling_transposed(ordernm_adjoint *a, scalar t, const scalar *z)
{
    int status = 0;
    for (int n = 0; n < a->ngroups && !status; ++n)
        status = transposed_settling(a, n, t, z, a->lambda + (long)n*a->n*a->width);
    return status;
}

/* Weights of the independent entries of the state at the end, from weights of all its entries. */
int ordernm_completion_transposed(ordernm_adjoint *a, int n, scalar *lambda)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    const ordernm_gradients *const g = a->gradients;
    ordernm_call c;
    ordernm_arguments(m, m->t, m->z, &c);
    c.q = g->whole_q, c.u = g->whole_u;
    take_weights(a, n, g->end_q, g->end_u, s->nq, s->nu);
    m->precise = s->precise != 0; /* condition numbers are large where independent coordinates change */
    return completion_transposed(a, n, &c, lambda);
}
