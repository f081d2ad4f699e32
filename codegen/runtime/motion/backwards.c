/* The discrete adjoint: every step of a motion in reverse order, then the gradients.
 *
 * Step sizes count as constants: they are not differentiated. */
#include "backwards.h"
#include "radau.h"

#include <string.h>

/* Lays out the memory of an adjoint; a is 0 if only the size is requested. */
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
    a->sampled = (long *)ordernm_take(&of, a->ngroups*sizeof(long));
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
    return 8 + (long)(lay_out(0, problem, (ordernm_gradients *)gradients)/sizeof(scalar)) + ordernm_room(&alone);
}

/* ---- From the end to the start. ---- */

ordernm_adjoint *ordernm_adjoint_begin(const ordernm_problem *problem, ordernm_gradients *g, scalar *room)
{
    ordernm_adjoint *const a = (ordernm_adjoint *)ordernm_line(room);
    const size_t used = lay_out(0, problem, g);
    memset(a, 0, used);
    lay_out(a, problem, g);
    a->motion = ordernm_begin(&a->problem, (scalar *)((char *)a + used));
    a->motion->results = &a->none;
    if (a->of_stages) ordernm_radau_layout_stages(a->motion, a->motion->ny, a->of_stages);
    a->behind = g->nbehind;
    a->timed = -1;
    for (int n = 0; n < a->ngroups; ++n) {
        a->sampled[n] = g->ntimes;
        scalar *const lambda = a->lambda + (long)n*a->n*a->width;
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
        if (g->whole_q && !g->singular) g->singular = ordernm_completion_transposed(a, n, lambda);
    }
    return a;
}

static int step_backwards(ordernm_adjoint *a, const scalar *step)
{
    if (step[5] != 0.0) return ordernm_root_transposed(a, (int)step[5] - 1, step[1]);
    return a->motion->radau ? ordernm_radau_backwards(a, step) : ordernm_explicit_backwards(a, step);
}

int ordernm_backwards(ordernm_adjoint *a, const scalar *steps, long count)
{
    ordernm_motion *const m = a->motion;
    const long size = ordernm_step_size(m->problem);
    for (long k = count - 1; k >= 0; --k) {
        const scalar *const step = steps + k*size;
        m->t = step[0];
        memcpy(m->z, step + m->head, (m->ny + m->nx + m->nd)*sizeof(scalar));
        ordernm_find_segment(m, m->t, step[1]);
        ordernm_take_derivatives(m, step[4]);
        ordernm_take_modes(m, step + ORDERNM_STEP_HEAD);
        int status = a->has_next ? ordernm_switches_transposed(a, a->next_t, a->next, a->next_modes) : 0;
        if (!status && step[1] > 0.0) status = step_backwards(a, step);
        if (!status) status = ordernm_sample_behind(a);
        if (m->nheld) {
            a->has_next = 1;
            a->next_t = m->t;
            memcpy(a->next, m->z, (m->ny + m->nx + m->nd)*sizeof(scalar));
            memcpy(a->next_modes, step + ORDERNM_STEP_HEAD, 2*m->system->nswitches*sizeof(scalar));
        }
        if (!status) continue;
        a->gradients->singular = status;
        return status == INFINITE ? ORDERNM_NOT_FINITE : status < -1 ? ORDERNM_COLLAPSED : status < 0 ? ORDERNM_OPEN : ORDERNM_SINGULAR;
    }
    return ORDERNM_ENDED;
}

/* Adds the contributions of outputs at the initial time, then copies the gradients from the lanes to the caller's arrays. */
void ordernm_adjoint_end(ordernm_adjoint *a)
{
    ordernm_motion *const m = a->motion;
    const ordernm_system *const s = m->system;
    ordernm_gradients *const g = a->gradients;
    const int width = a->width;
    const long count = m->problem->inputs.count*ordernm_signals(s);
    for (int n = 0; n < a->ngroups; ++n) {
        scalar *const lambda = a->lambda + (long)n*a->n*width;
        while (a->sampled[n] > 0) {
            const scalar t = g->times[a->sampled[n] - 1];
            if (!ordernm_sample_transposed(a, n, t, m->z, a->nu)) ordernm_accumulate(lambda, 1.0, a->nu, (long)a->n*width);
        }
    }
    ordernm_settling_transposed(a, m->t, m->z); /* transposes the adjustments that made the initial state consistent */
    for (int n = 0; n < a->ngroups; ++n) {
        const scalar *const lambda = a->lambda + (long)n*a->n*width;
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

/* ---- Steps that were not stored are repeated. ---- */

static int replay(ordernm_motion *m, const scalar *known, int first, scalar *step)
{
    return m->radau ? ordernm_radau_replay(m, known, step) : ordernm_explicit_replay(m, first, step);
}

int ordernm_replay(ordernm_motion *m, const scalar *known, scalar *steps, long count)
{
    const long size = ordernm_step_size(m->problem);
    const size_t state = (m->ny + m->nx + m->nd)*sizeof(scalar);
    int status;
    ordernm_results none = {.steps = steps};
    m->results = &none;
    memcpy(m->z, steps + m->head, state);
    ordernm_take_modes(m, steps + ORDERNM_STEP_HEAD);
    for (long k = 0; k < count; ++k) {
        scalar *const step = steps + k*size;
        m->t = step[0];
        memcpy(step + m->head, m->z, state);
        ordernm_find_segment(m, m->t, step[1]);
        ordernm_take_derivatives(m, step[4]);
        if (step[1] == 0.0) break; /* a row of step size zero: the state after the event that ends the motion */
        if (replay(m, k ? 0 : known, !k, step)) return ORDERNM_SINGULAR;
        m->method->keep(m, step);
        if (k + 1 == count) break;
        if (step[5] != 0.0) m->root_end = step[size];
        const scalar end = step[size], knot = ordernm_next_knot(m, m->t);
        m->closed_known = 0;
        if (!m->method->gives_rate && ordernm_rates_at_end(m, end, m->rate[m->method->stages])) return ORDERNM_SINGULAR;
        if ((status = ordernm_next_step(m, end, knot, 0, step + size + ORDERNM_STEP_HEAD))) return status < 0 ? ORDERNM_OPEN : ORDERNM_SINGULAR;
    }
    return ORDERNM_ENDED;
}
