/* Derivatives of all variables with respect to states, inputs, parameters and time, with loops that stay closed. */
#include "unit.h"

#include <math.h>
#include <string.h>

static const char NOT_KNOWN[] = "there are no derivatives with respect to %s, only with respect to independent coordinates and speeds, "
                                "parameters, inputs and time";

/* The entry of a variable in the arrays `of`, one for each of q, u, p, inputs, t; null if there are no derivatives with respect to it. */
static scalar *place_of(const unit *x, unsigned variable, scalar *const *of)
{
    int k, found = 0;
    const int kind = unit_of(x, variable, &k);
    if (kind == OF_TIME || kind == OF_PARAMETER || kind == OF_INPUT) return of[kind == OF_TIME ? 4 : kind == OF_PARAMETER ? 2 : 3] + k;
    if (kind != OF_Q && kind != OF_U) return 0;
    const int n = kind == OF_Q ? x->nfq : x->nfu;
    for (int i = 0; i < n; ++i) found |= (kind == OF_Q ? x->system->free_q : x->system->free_u)[i] == k;
    return found ? of[kind == OF_Q ? 0 : 1] + k : 0;
}

static void clear(const unit *x, scalar *const *of)
{
    const int sizes[] = {x->nq, x->nu, x->np, x->ni, 1};
    for (int n = 0; n < 5; ++n) memset(of[n], 0, sizes[n]*sizeof(scalar));
}

/* The kinds of the unknowns, a bit for each; 0 after an error. */
static unsigned kinds_of(unit *x, const unsigned *unknowns, size_t n)
{
    unsigned found = 0;
    for (size_t i = 0; i < n; ++i) {
        int k;
        const int kind = unit_of(x, unknowns[i], &k);
        if (kind == OF_NOTHING || kind == OF_TIME || kind == OF_PARAMETER || kind == OF_INPUT) {
            unit_say(x, UNIT_ERROR, "%s has no derivatives, only coordinates, speeds, their time derivatives, outputs and event indicators",
                unit_name(x, unknowns[i]));
            return 0;
        }
        found |= 1u << kind;
    }
    return found | 1u << OF_NOTHING;
}

/* Derivatives of all unknowns along the seeds. Returns the status of a function. */
static int differentiate(unit *x, ordernm_call *c, unsigned kinds)
{
    const ordernm_system *const s = x->system;
    int status = 0;
    scalar *const dq = c->dq, *const du = c->du;
    c->dqdot = x->dqdot, c->dudot = x->dudot, c->doutputs = x->doutputs, c->dswitches = x->dswitches;
    c->dfull_q = x->dfull_q, c->dfull_u = x->dfull_u;
    if (kinds & 1u << OF_RATE) status = s->state_rate_sensitivities[ORDERNM_ONE](c);
    if (!status && kinds & 1u << OF_OUTPUT) status = s->output_sensitivities[ORDERNM_ONE](c);
    if (!status && kinds & 1u << OF_SWITCH) status = s->switch_sensitivities[ORDERNM_ONE](c);
    if (status || !(kinds & (1u << OF_Q | 1u << OF_U))) return status;
    if (s->completion_sensitivities[ORDERNM_ONE]) return s->completion_sensitivities[ORDERNM_ONE](c);
    memcpy(x->dfull_q, dq, x->nq*sizeof(scalar));
    memcpy(x->dfull_u, du, x->nu*sizeof(scalar));
    return 0;
}

/* The entry of an unknown in the arrays of derivatives, or of weights. The derivative of the unknown is this entry times `factor`, which
 * differs from one for event indicators of angles. */
static scalar *unknown_of(const unit *x, unsigned variable, scalar *factor)
{
    const ordernm_system *const s = x->system;
    int k;
    *factor = 1.0;
    switch (unit_of(x, variable, &k)) {
    case OF_Q: return x->dfull_q + k;
    case OF_U: return x->dfull_u + k;
    case OF_RATE: return k < x->nfq ? x->dqdot + s->free_q[k] : x->dudot + s->free_u[k - x->nfq];
    case OF_OUTPUT: return x->doutputs + k;
    default: unit_indicator(x, k, factor); return x->dswitches + x->model->indicators[k];
    }
}

/* Until initialisation ends: adds the seeds of initial values that follow from the parameters. Returns the status of a function. */
static int seed_initial(unit *x)
{
    const ordernm_system *const s = x->system;
    if (!x->model->initial_along || *x->mode > INITIALIZING) return 0;
    const int status = x->model->initial_along(x->p, x->dp, x->near, x->dfull_u, x->dqdot, x->dudot, x->motion->work);
    for (int i = 0; i < x->nfq; ++i)
        if (x->given[i] == 0.0) x->dq[s->free_q[i]] += x->dqdot[s->free_q[i]];
    for (int i = 0; i < x->nfu; ++i)
        if (x->given[x->nfq + i] == 0.0) x->du[s->free_u[i]] += x->dudot[s->free_u[i]];
    return status;
}

/* The earliest time after `after` at which a switch that is linear in time is zero; infinite if there is none. */
int unit_next_event(unit *x, scalar after, scalar *next)
{
    scalar *const of[] = {x->dq, x->du, x->dp, x->di, x->dt};
    const unit_model *const m = x->model;
    ordernm_call c;
    int status = unit_update(x);
    if (status) return status;
    clear(x, of);
    *x->dt = 1.0;
    unit_arguments(x, &c);
    if ((status = differentiate(x, &c, 1u << OF_SWITCH))) return unit_failed(x, status);
    *next = INFINITY;
    for (int i = 0; i < m->nscheduled; ++i) {
        const scalar at = *x->t - x->switches[m->scheduled[i]]/x->dswitches[m->scheduled[i]];
        if (at > after && at < *next) *next = at;
    }
    return UNIT_OK;
}

/* result = d unknowns/d knowns * seed. */
int unit_along(unit *x, const unsigned *unknowns, size_t nunknowns, const unsigned *knowns, size_t nknowns, const scalar *seed,
    scalar *result)
{
    scalar *const of[] = {x->dq, x->du, x->dp, x->di, x->dt};
    ordernm_call c;
    if (unit_has(x, nunknowns, unknowns, result) || unit_has(x, nknowns, knowns, seed)) return UNIT_ERROR;
    int status = unit_update(x);
    if (status) return status;
    const unsigned kinds = kinds_of(x, unknowns, nunknowns);
    if (!kinds) return UNIT_ERROR;
    clear(x, of);
    for (size_t i = 0; i < nknowns; ++i) {
        scalar *const to = place_of(x, knowns[i], of);
        if (!to) return unit_say(x, UNIT_ERROR, NOT_KNOWN, unit_name(x, knowns[i]));
        *to += seed[i];
    }
    if ((status = seed_initial(x))) return unit_failed(x, status);
    unit_arguments(x, &c);
    if ((status = differentiate(x, &c, kinds))) return unit_failed(x, status);
    for (size_t i = 0; i < nunknowns; ++i) {
        scalar factor;
        const scalar *const found = unknown_of(x, unknowns[i], &factor);
        result[i] = factor*(*found);
    }
    return UNIT_OK;
}

/* Calls a transpose, and adds its gradients to the sums. */
static int add(unit *x, ordernm_call *c, ordernm_function *function)
{
    scalar *const of[] = {x->dq, x->du, x->dp, x->di, x->dt};
    const int sizes[] = {x->nq, x->nu, x->np, x->ni, 1};
    clear(x, of);
    const int status = function(c);
    for (int n = 0; n < 5; ++n)
        for (int i = 0; i < sizes[n]; ++i) x->gradient[n][i] += of[n][i];
    return status;
}

/* Adds gradients with respect to the parameters that determine initial values, until initialisation ends. Returns the status of a
 * function. */
static int add_initial(unit *x)
{
    scalar *const of[] = {x->dq, x->du, x->dp, x->di, x->dt};
    const ordernm_system *const s = x->system;
    int status = 0;
    if (!x->model->initial_along || *x->mode > INITIALIZING) return 0;
    for (int k = 0; k < x->np && !status; ++k) {
        clear(x, of);
        x->dp[k] = 1.0;
        status = seed_initial(x);
        for (int i = 0; i < x->nfq; ++i) x->gradient[2][k] += x->gradient[0][s->free_q[i]]*x->dq[s->free_q[i]];
        for (int i = 0; i < x->nfu; ++i) x->gradient[2][k] += x->gradient[1][s->free_u[i]]*x->du[s->free_u[i]];
    }
    return status;
}

/* Gradients of the weighted sum of unknowns. Returns the status of a function. */
static int transpose(unit *x, ordernm_call *c, unsigned kinds)
{
    const ordernm_system *const s = x->system;
    int status = 0;
    c->dqdot = x->dqdot, c->dudot = x->dudot, c->doutputs = x->doutputs, c->dswitches = x->dswitches;
    c->dfull_q = x->dfull_q, c->dfull_u = x->dfull_u;
    if (kinds & 1u << OF_RATE) {
        status = add(x, c, s->sensitivities_transposed[ORDERNM_ONE]);
        if (s->plain_rates)
            for (int i = 0; i < x->nq; ++i) x->gradient[1][i] += x->dqdot[i];
        else if (!status) status = add(x, c, s->coordinate_rate_sensitivities_transposed[ORDERNM_ONE]);
    }
    if (!status && kinds & 1u << OF_OUTPUT) status = add(x, c, s->output_sensitivities_transposed[ORDERNM_ONE]);
    if (!status && kinds & 1u << OF_SWITCH) status = add(x, c, s->switch_sensitivities_transposed[ORDERNM_ONE]);
    if (status || !(kinds & (1u << OF_Q | 1u << OF_U))) return status;
    if (s->completion_sensitivities_transposed[ORDERNM_ONE]) return add(x, c, s->completion_sensitivities_transposed[ORDERNM_ONE]);
    for (int i = 0; i < x->nq; ++i) x->gradient[0][i] += x->dfull_q[i];
    for (int i = 0; i < x->nu; ++i) x->gradient[1][i] += x->dfull_u[i];
    return 0;
}

/* result = seed^T * d unknowns/d knowns. */
int unit_adjoint(unit *x, const unsigned *unknowns, size_t nunknowns, const unsigned *knowns, size_t nknowns, const scalar *seed,
    scalar *result)
{
    ordernm_call c;
    if (unit_has(x, nunknowns, unknowns, seed) || unit_has(x, nknowns, knowns, result)) return UNIT_ERROR;
    int status = unit_update(x);
    if (status) return status;
    const unsigned kinds = kinds_of(x, unknowns, nunknowns);
    if (!kinds) return UNIT_ERROR;
    for (size_t i = 0; i < nknowns; ++i)
        if (!place_of(x, knowns[i], x->gradient)) return unit_say(x, UNIT_ERROR, NOT_KNOWN, unit_name(x, knowns[i]));
    scalar *const weights[] = {x->dfull_q, x->dqdot, x->dfull_u, x->dudot, x->doutputs, x->dswitches};
    const int sizes[] = {x->nq, x->nq, x->nu, x->nu, x->ny, x->ns};
    for (int n = 0; n < 6; ++n) memset(weights[n], 0, sizes[n]*sizeof(scalar));
    for (size_t i = 0; i < nunknowns; ++i) {
        scalar factor;
        scalar *const to = unknown_of(x, unknowns[i], &factor);
        *to += factor*seed[i];
    }
    clear(x, x->gradient);
    unit_arguments(x, &c);
    if ((status = transpose(x, &c, kinds)) || (status = add_initial(x))) return unit_failed(x, status);
    for (size_t i = 0; i < nknowns; ++i) result[i] = *place_of(x, knowns[i], x->gradient);
    return UNIT_OK;
}
