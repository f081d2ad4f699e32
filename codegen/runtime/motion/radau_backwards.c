/* The adjoint of a step of Radau IIA.
 *
 * Its stages satisfy A^-1 Z/h = f(z + Z[i]). Its end, and every state in between, is z + sum(w[i] Z[i]). Given lambda = dJ/dz+ and
 * weights of states in between, in lanes of functionals, with g for the integrated outputs:
 *
 *     right_i = w_i lambda + ... + g_z(Y_i)^T gamma_i,  gamma_i = h a_3i lambda_g,
 *     sum_j (A^-1)_ji mu_j/h - f_z(Y_i)^T mu_i = right_i,
 *     lambda <- lambda + ... + sum f_z(Y_i)^T mu_i + g_z(Y_i)^T gamma_i,  gradient += f_p(Y_i)^T mu_i + g_p(Y_i)^T gamma_i.
 *
 * These are the transposed equations of the stages' derivatives, see radau_transposed.c. */
#include "backwards.h"
#include "radau.h"

#include <string.h>

/* An adjoint, and the number of a group of functionals. */
typedef struct {
    ordernm_adjoint *a;
    int n;
} of_group;

static int rates_transposed(const ordernm_transposed *e, int i)
{
    const of_group *const of = (const of_group *)e->of;
    ordernm_adjoint *const a = of->a;
    ordernm_motion *const m = a->motion;
    m->precise = m->precise_stages >> i & 1u;
    return ordernm_rates_transposed(a, of->n, ordernm_time_of_stage(m->t, e->h, i), a->stage[i], a->q[i], e->change[i], e->nu);
}

/* The adjoint of one step for one group of functionals: lambda at the end of the step becomes lambda at its start. */
static int group_backwards(ordernm_adjoint *a, int n, scalar h)
{
    ordernm_motion *const m = a->motion;
    const long size = (long)m->ny*a->width, all = (long)a->n*a->width;
    scalar *const lambda = a->lambda + n*all, *const *const right = a->kappa, *const gamma = a->kappa[STAGES];
    int status;
    for (int i = 0; i < STAGES; ++i) memset(right[i], 0, size*sizeof(scalar));
    memcpy(right[STAGES - 1], lambda, size*sizeof(scalar));
    while (ordernm_samples_left(a, n)) {
        const scalar at = a->gradients->times[a->sampled[n] - 1];
        scalar w[STAGES];
        ordernm_radau_weights((at - m->t)/h, w);
        for (long k = 0; k < m->values; ++k)
            m->trial[k] = (1.0 - w[0] - w[1] - w[2])*m->z[k] + w[0]*a->stage[0][k] + w[1]*a->stage[1][k] + w[2]*a->stage[2][k];
        if ((status = ordernm_sample_transposed(a, n, at, m->trial, a->nu))) return status;
        ordernm_accumulate(lambda, 1.0, a->nu, size);
        for (int i = 0; i < STAGES; ++i) ordernm_accumulate(right[i], w[i], a->nu, size);
    }
    for (int i = 0; i < STAGES && m->nx; ++i) {
        memset(gamma, 0, all*sizeof(scalar));
        ordernm_accumulate(gamma + size, h*A[STAGES - 1][i], lambda + size, all - size);
        memset(a->nu, 0, all*sizeof(scalar));
        const scalar t = ordernm_time_of_stage(m->t, h, i);
        m->precise = m->precise_stages >> i & 1u;
        if ((status = ordernm_integrals_transposed(a, n, t, a->stage[i], a->q[i], gamma, a->nu))) return status;
        ordernm_accumulate(right[i], 1.0, a->nu, size);
        ordernm_accumulate(lambda, 1.0, a->nu, size);
    }
    of_group of = {a, n};
    const ordernm_transposed equations = {.motion = m, .h = h, .width = a->width, .stage = a->stage, .right = right,
        .change = a->kappa + STAGES, .mu = a->kappa + 2*STAGES, .lambda = lambda, .nu = a->nu, .of = &of,
        .rates_transposed = rates_transposed};
    return ordernm_radau_solve_adjoint(&equations);
}

int ordernm_radau_backwards(ordernm_adjoint *a, const scalar *row)
{
    ordernm_motion *const m = a->motion;
    const long state = m->ny + m->nx + m->nd;
    const scalar h = row[1];
    int status;
    m->radau->jacobian_here = m->radau->formed_here = 0;
    m->precise_stages = (unsigned)row[2] >> 1;
    for (int i = 0; i < STAGES; ++i) {
        scalar *const stage = a->stage[i];
        memcpy(stage, row + m->head + (1 + i)*state, state*sizeof(scalar));
        if (m->identity) continue;
        ordernm_call c;
        ordernm_arguments(m, ordernm_time_of_stage(m->t, h, i), stage, &c);
        if (m->system->split && (status = ordernm_close_loops(m, &c))) return status; /* for joints that are not split, the loops are still closed */
        memcpy(a->q[i], m->q, m->system->nq*sizeof(scalar));
    }
    if (m->system->split && (status = ordernm_settling_transposed(a, m->t + h, a->stage[STAGES - 1]))) return status;
    for (int n = 0; n < a->ngroups; ++n)
        if ((status = group_backwards(a, n, h))) return status;
    return 0;
}
