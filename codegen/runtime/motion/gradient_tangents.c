/* One state for Hessian products: its record, and the derivatives of its rates with their tangents.
 *
 * Adjoints have the layout of the state z: values, then tangents along the directions. */
#include "curvature.h"

#include <string.h>

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

void ordernm_unpack(const ordernm_curvature *c, const scalar *z, scalar *to)
{
    const ordernm_motion *const m = c->motion;
    memcpy(to, z, c->n*sizeof(scalar));
    for (const group *g = m->groups; g < m->groups + m->ngroups; ++g)
        for (int l = 0; l < g->used; ++l)
            for (int i = 0; i < c->n; ++i) to[(1 + g->first + l)*c->n + i] = z[g->at + (long)i*g->width + l];
}

void ordernm_pack(const ordernm_curvature *c, const scalar *from, scalar *z)
{
    const ordernm_motion *const m = c->motion;
    memcpy(z, from, c->n*sizeof(scalar));
    for (const group *g = m->groups; g < m->groups + m->ngroups; ++g)
        for (int l = 0; l < g->used; ++l)
            for (int i = 0; i < c->n; ++i) z[g->at + (long)i*g->width + l] = from[(1 + g->first + l)*c->n + i];
}

/* The state of a record, its dependent coordinates included. */
void ordernm_take_record(const ordernm_curvature *c, const scalar *record, scalar *z)
{
    const ordernm_motion *const m = c->motion;
    ordernm_pack(c, record, z);
    for (int k = 0; k < m->nd; ++k) z[m->ny + m->nx + k] = record[size_of_rows(c) + m->dependent[k]];
}

/* A record of a state whose loops have just been closed. */
static void keep(const ordernm_curvature *c, const scalar *z, scalar *to)
{
    const ordernm_motion *const m = c->motion;
    ordernm_unpack(c, z, to);
    if (!m->identity) memcpy(to + size_of_rows(c), m->q, m->system->nq*sizeof(scalar));
}

/* Rates at a stage of a stored step whose loops are closed, and its record; with a negative number of the stage, closes the loops. With
 * loops, m->dudot contains the tangents of udot only until the next group is computed. */
int ordernm_rates_and_keep(const ordernm_curvature *c, scalar t, const scalar *z, scalar *rate, int stage, scalar *to)
{
    ordernm_motion *const m = c->motion;
    const ordernm_system *const s = m->system;
    scalar *dudot = to + rates_at(c);
    const int closed = stage < 0 ? 0 : m->precise_stages >> stage & 1u ? KNOWN_CLOSED | PRECISE : KNOWN_CLOSED;
    for (group *g = m->groups; g < m->groups + m->ngroups; dudot += s->nu*g++->width) {
        const int status = ordernm_rates_of(m, t, z, rate, 1, g, RATES | closed);
        if (status) return status;
        memcpy(dudot, m->identity ? rate + g->at + s->nq*g->width : m->dudot, s->nu*g->width*sizeof(scalar));
    }
    keep(c, z, to);
    return 0;
}

int ordernm_close_and_keep(const ordernm_curvature *c, scalar t, const scalar *z, scalar *to)
{
    ordernm_call call;
    ordernm_arguments(c->motion, t, z, &call);
    const int status = ordernm_close_loops(c->motion, &call);
    if (!status) keep(c, z, to);
    return status;
}

/* ---- Derivatives of rates at the state of a record. ---- */

/* Converts gradients with respect to inputs at a time, or to time derivatives of the inputs, of the given order, to gradients with respect
 * to control points, and adds these; `from` is 0 for values, 1 + k for direction k. */
void ordernm_add_inputs(ordernm_curvature *c, scalar t, int of_order, const scalar *of, int width, long from, int used, scalar factor)
{
    ordernm_motion *const m = c->motion;
    const ordernm_system *const s = m->system;
    const ordernm_inputs *const in = &m->problem->inputs;
    scalar value[ORDERNM_ORDERS][ORDERNM_MOST_DEGREE + 1];
    const int signals = ordernm_signals(s);
    const long first = ordernm_input_weights(m, t, of_order, value);
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
    if (s->ninputs) ordernm_add_inputs(c, t, 0, of->inputs, width, from, used, 1.0);
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
void ordernm_clear_gradient(const ordernm_curvature *c, const gradient *of, int width)
{
    const ordernm_system *const s = c->motion->system;
    memset(of->q, 0, s->nq*width*sizeof(scalar));
    memset(of->u, 0, s->nu*width*sizeof(scalar));
    memset(of->p, 0, s->np*width*sizeof(scalar));
    memset(of->inputs, 0, s->ninputs*width*sizeof(scalar));
    memset(of->t, 0, width*sizeof(scalar));
}

/* Arguments at the state of a record. */
static void at_record(ordernm_curvature *c, scalar t, const scalar *z, const scalar *record, ordernm_call *call)
{
    ordernm_arguments(c->motion, t, z, call);
    if (!c->motion->identity) call->q = record + size_of_rows(c);
}

/* Adds the transposed derivatives of the rates of coordinates to nu, if these rates are not the speeds; for values or for the directions of
 * a group. */
static int rates_transposed(ordernm_curvature *c, ordernm_call call, scalar t, const scalar *kappa, scalar *nu, const group *g)
{
    const ordernm_system *const s = c->motion->system;
    const int width = g ? g->width : 1;
    const gradient *const to = g ? &c->along : &c->values;
    ordernm_clear_gradient(c, to, width);
    memset(c->dqdot, 0, s->nq*width*sizeof(scalar));
    for (int i = 0; i < s->nfree_q; ++i)
        memcpy(c->dqdot + s->free_q[i]*width, kappa + (g ? g->at : 0) + i*width, width*sizeof(scalar));
    call.qdot = c->motion->qdot, call.dqdot = c->dqdot;
    call.dq = to->q, call.du = to->u, call.dp = to->p, call.dinputs = to->inputs, call.dt = to->t;
    const int status = s->coordinate_rate_sensitivities_transposed[g ? g->index : ORDERNM_ONE](&call);
    if (!status) add(c, t, to, nu, g);
    return status;
}

/* Adds the changes of these transposed derivatives along all directions to nu and, if `values` is not 0, the derivatives themselves. */
static int rate_gradients(ordernm_curvature *c, scalar t, const scalar *z, const scalar *record, const scalar *kappa, scalar *nu,
    int values)
{
    ordernm_motion *const m = c->motion;
    const ordernm_system *const s = m->system;
    const gradient *const d = &c->along;
    ordernm_call call;
    at_record(c, t, z, record, &call);
    int status = values ? rates_transposed(c, call, t, kappa, nu, 0) : 0;
    for (const group *g = m->groups; !status && g < m->groups + m->ngroups; ++g) {
        if ((status = rates_transposed(c, call, t, kappa, nu, g))) break;
        ordernm_clear_gradient(c, d, g->width);
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

/* Adds to nu the changes of f_z^T kappa along all directions at the state of a record, and f_z^T kappa itself if `values` is not 0. */
int ordernm_gradients_along(ordernm_curvature *c, scalar t, const scalar *z, const scalar *record, const scalar *kappa, scalar *nu,
    int values)
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
    if (values) add(c, t, v, nu, 0);
    if (values) add_rates(c, kappa, nu, 0);
    return s->plain_rates ? 0 : rate_gradients(c, t, z, record, kappa, nu, values);
}

/* Adds f_z^T kappa at the state of a record to nu, for values or for the directions of a group. */
int ordernm_gradients_of(ordernm_curvature *c, scalar t, const scalar *z, const scalar *record, const scalar *kappa, scalar *nu,
    const group *g)
{
    const ordernm_system *const s = c->motion->system;
    const int width = g ? g->width : 1;
    const gradient *const to = g ? &c->along : &c->values;
    const scalar *const weights = kappa + (g ? g->at : 0);
    ordernm_call call;
    at_record(c, t, z, record, &call);
    ordernm_clear_gradient(c, to, width);
    memset(c->db, 0, s->nu*width*sizeof(scalar));
    for (int i = 0; i < s->nfree_u; ++i)
        memcpy(c->db + s->free_u[i]*width, weights + (s->nfree_q + i)*width, width*sizeof(scalar));
    call.qdot = c->motion->qdot, call.udot = c->motion->udot, call.dudot = c->db;
    call.dq = to->q, call.du = to->u, call.dp = to->p, call.dinputs = to->inputs, call.dt = to->t;
    const int status = s->sensitivities_transposed[g ? g->index : ORDERNM_ONE](&call);
    if (status) return status;
    add(c, t, to, nu, g);
    add_rates(c, kappa, nu, g);
    return s->plain_rates ? 0 : rates_transposed(c, call, t, kappa, nu, g);
}

/* Adds a lane of the results of a function to a row of derivatives with respect to independent entries, parameters and inputs; returns the
 * derivative with respect to time. */
scalar ordernm_add_row(const ordernm_curvature *c, const gradient *of, int width, int lane, scalar *row)
{
    const ordernm_system *const s = c->motion->system;
    for (int i = 0; i < s->nfree_q; ++i) *row++ += of->q[s->free_q[i]*width + lane];
    for (int i = 0; i < s->nfree_u; ++i) *row++ += of->u[s->free_u[i]*width + lane];
    for (int i = 0; i < s->np; ++i) *row++ += of->p[i*width + lane];
    for (int i = 0; i < s->ninputs; ++i) *row++ += of->inputs[i*width + lane];
    return of->t[lane];
}

/* Adds the derivatives of weighted outputs at the state of a record to a source. */
int ordernm_outputs_along(ordernm_curvature *c, scalar t, const scalar *record, const scalar *weights, scalar *source)
{
    ordernm_motion *const m = c->motion;
    const ordernm_system *const s = m->system;
    const gradient *const v = &c->values, *const d = &c->along;
    const long length = c->n + s->np + s->ninputs;
    ordernm_call call;
    ordernm_take_record(c, record, m->trial);
    at_record(c, t, m->trial, record, &call);
    ordernm_clear_gradient(c, v, 1);
    call.outputs = m->outputs, call.doutputs = (scalar *)weights;
    call.dq = v->q, call.du = v->u, call.dp = v->p, call.dinputs = v->inputs, call.dt = v->t;
    int status = s->output_sensitivities_transposed[ORDERNM_ONE](&call);
    ordernm_add_row(c, v, 1, 0, source);
    for (const group *g = m->groups; g < m->groups + m->ngroups && !status; ++g) {
        ordernm_seeds(m, t, m->trial, g, &call);
        ordernm_clear_gradient(c, d, g->width);
        call.dt = c->no_dt, call.output_weights = weights;
        call.dgq = d->q, call.dgu = d->u, call.dgp = d->p, call.dginputs = d->inputs, call.dgt = d->t;
        status = s->output_hessian_products[g->index](&call);
        for (int l = 0; l < g->used; ++l) ordernm_add_row(c, d, g->width, l, source + (1L + g->first + l)*length);
    }
    return status;
}

/* Adds `factor` times the derivatives of weighted outputs at a state, [1 + k][nq + nu + np + ninputs]. */
void ordernm_add_source(ordernm_curvature *c, scalar t, scalar factor, const scalar *source, scalar *nu)
{
    const ordernm_motion *const m = c->motion;
    const ordernm_system *const s = m->system;
    const long length = c->n + s->np + s->ninputs;
    for (long d = 0; d <= c->problem.ndirections; ++d, source += length) {
        const group *const g = d ? m->groups + (d - 1)/LANES : 0;
        const long at = g ? g->at + d - 1 - g->first : 0, stride = g ? g->width : 1;
        for (int i = 0; i < c->n; ++i) nu[at + i*stride] += factor*source[i];
        for (int i = 0; i < s->np; ++i) c->found->p[d*s->np + i] += factor*source[c->n + i];
        if (s->ninputs) ordernm_add_inputs(c, t, 0, source + c->n + s->np, 1, d, 1, factor);
    }
}

/* Stores the records of the states at the times of outputs within a step, after its rates or stages have been computed. */
int ordernm_states_within(ordernm_curvature *c, scalar h, scalar until)
{
    ordernm_motion *const m = c->motion;
    ordernm_hessians *const found = c->found;
    for (; c->next < found->ntimes && found->times[c->next] <= until; ++c->next) {
        m->method->interpolate(m, h, (found->times[c->next] - m->t)/h, m->trial);
        const int status = ordernm_close_and_keep(c, found->times[c->next], m->trial, found->states + c->next*ordernm_hessians_record(c));
        if (status) return status;
    }
    return 0;
}

/* Adds the adjoints of the outputs at times within the current step to lambda and, times the factors of `count` stages in the state at such
 * a time and times `by`, to kappa. */
void ordernm_samples_back(ordernm_curvature *c, scalar h, void (*weights)(scalar theta, scalar *factor), int count, scalar by)
{
    ordernm_motion *const m = c->motion;
    const ordernm_hessians *const found = c->found;
    scalar factor[MOST_STAGES];
    for (; c->left > 0 && found->times[c->left - 1] > m->t; --c->left) {
        const scalar at = found->times[c->left - 1];
        memset(c->nu, 0, m->size*sizeof(scalar));
        ordernm_add_source(c, at, 1.0, found->sources + (c->left - 1)*ordernm_source_size(c), c->nu);
        ordernm_add_to(c->lambda, 1.0, c->nu, m->size);
        weights((at - m->t)/h, factor);
        for (int j = 0; j < count; ++j) ordernm_add_to(c->kappa[j], by*factor[j], c->nu, m->size);
    }
}
