/* A step of Radau IIA with tangents, and its adjoint with tangents.
 *
 * With the notation of radau_backwards.c, and d for changes along a direction, the stages' derivatives dY_i are those of the step actually
 * made, and
 *
 *     sum_j (A^-1)_ji dmu_j/h - f_z(Y_i)^T dmu_i = dright_i + (f_zz dY_i + f_zp dp)^T mu_i,
 *
 * the same equations as for mu. One function gives the last term; transposes in lanes give f_z^T dmu_i. */
#include "curvature.h"
#include "radau.h"

#include <string.h>

/* Derivatives of the stages of a stored step along all directions. */
static int derive_stages(ordernm_motion *m, const scalar *step)
{
    struct radau *const r = m->radau;
    const scalar h = step[1], *stage = step + m->head;
    const long state = m->ny + m->nx + m->nd;
    int formed = 0, status;
    m->precise_stages = (unsigned)step[2] >> 1;
    r->formed_here = 0;
    for (int i = 0; i < STAGES; ++i) {
        stage += state;
        for (long k = 0; k < state; ++k) r->stage[i][k] = stage[k] - m->z[k];
        memset(r->stage[i] + m->values, 0, (m->size - m->values)*sizeof(scalar));
    }
    if (!r->formed && (!r->accepted || (unsigned)step[2] & 1u)) { /* for sweeps: the Jacobian that the original step used */
        if ((status = ordernm_radau_differentiate(m, m->t, m->z, r->jacobian, 0))) return status;
        ordernm_radau_take_jacobian(r);
        r->accepted = 1;
    }
    if (!r->formed && r->h_factored != h && ordernm_radau_factorise(m, h)) return DIVERGED;
    for (const group *g = m->groups; g < m->groups + m->ngroups; ++g)
        if ((status = ordernm_radau_along(m, h, g, KNOWN_CLOSED, &formed)) != CONVERGED) return status;
    return 0;
}

int ordernm_radau_step_along(ordernm_curvature *c, const scalar *step, scalar until, scalar *records, scalar *nodes)
{
    ordernm_motion *const m = c->motion;
    struct radau *const r = m->radau;
    const scalar h = step[1];
    const long record = ordernm_hessians_record(c);
    int status = derive_stages(m, step);
    for (int i = 0; i < STAGES && !status; ++i) {
        const scalar t = ordernm_time_of_stage(m->t, h, i);
        for (long k = 0; k < m->size; ++k) m->trial[k] = m->z[k] + r->stage[i][k];
        status = ordernm_rates_and_keep(c, t, m->trial, m->rate[1 + i], i, records + i*record);
        nodes[2*i] = t, nodes[2*i + 1] = h*A[STAGES - 1][i];
    }
    if (!status) status = ordernm_states_within(c, h, until);
    for (long k = 0; k < m->size; ++k) m->next[k] = m->z[k] + r->stage[STAGES - 1][k];
    return status;
}

/* The records of a step, and a group of directions; 0 for values. */
typedef struct {
    ordernm_curvature *c;
    const group *g;
    const scalar *records;
} of_group;

static int rates_transposed(const ordernm_transposed *e, int i)
{
    const of_group *const of = (const of_group *)e->of;
    const scalar t = ordernm_time_of_stage(e->motion->t, e->h, i), *const record = of->records + i*ordernm_hessians_record(of->c);
    memset(e->nu + e->at, 0, (long)e->motion->ny*e->width*sizeof(scalar));
    return ordernm_gradients_of(of->c, t, e->stage[i], record, e->change[i], e->nu, of->g);
}

/* Right sides of the equations from lambda, outputs at times and integrands; the states of the stages. */
static void begin_back(ordernm_curvature *c, scalar h, const scalar *records, const scalar *integrands, scalar *const *stage)
{
    ordernm_motion *const m = c->motion;
    const long record = ordernm_hessians_record(c);
    for (int i = 0; i < STAGES; ++i) memset(c->kappa[i], 0, m->size*sizeof(scalar));
    memcpy(c->kappa[STAGES - 1], c->lambda, m->size*sizeof(scalar));
    ordernm_samples_back(c, h, ordernm_radau_weights, STAGES, 1.0);
    for (int i = 0; i < STAGES; ++i) {
        ordernm_take_record(c, records + i*record, stage[i]);
        if (!integrands) continue;
        memset(c->nu, 0, m->size*sizeof(scalar));
        ordernm_add_source(c, ordernm_time_of_stage(m->t, h, i), h*A[STAGES - 1][i], integrands + i*ordernm_source_size(c), c->nu);
        ordernm_add_to(c->kappa[i], 1.0, c->nu, m->size);
        ordernm_add_to(c->lambda, 1.0, c->nu, m->size);
    }
}

int ordernm_radau_along_back(ordernm_curvature *c, scalar h, const scalar *records, const scalar *integrands)
{
    ordernm_motion *const m = c->motion;
    scalar *const *const mu = c->kappa + 2*STAGES, *const *const stage = c->kappa + 3*STAGES;
    of_group of = {c, 0, records};
    ordernm_transposed equations = {.motion = m, .h = h, .width = 1, .stage = stage, .right = c->kappa, .change = c->kappa + STAGES,
        .mu = mu, .lambda = c->lambda, .nu = c->nu, .of = &of, .rates_transposed = rates_transposed};
    m->radau->jacobian_here = m->radau->formed_here = 0;
    m->precise_stages = 0;
    begin_back(c, h, records, integrands, stage);
    int status = ordernm_radau_solve_adjoint(&equations);
    for (int i = 0; i < STAGES && !status; ++i) {
        memset(mu[i] + m->values, 0, (m->size - m->values)*sizeof(scalar));
        memset(c->nu, 0, m->size*sizeof(scalar));
        const scalar t = ordernm_time_of_stage(m->t, h, i);
        status = ordernm_gradients_along(c, t, stage[i], records + i*ordernm_hessians_record(c), mu[i], c->nu, 0);
        ordernm_add_to(c->kappa[i], 1.0, c->nu, m->size);
        ordernm_add_to(c->lambda, 1.0, c->nu, m->size);
    }
    for (const group *g = m->groups; g < m->groups + m->ngroups && !status; ++g) {
        of.g = g, equations.at = g->at, equations.width = g->width;
        status = ordernm_radau_solve_adjoint(&equations);
    }
    return status;
}
