/* The adjoint of a step of Radau IIA.
 *
 * Its stages satisfy A^-1 Z/h = f(z + Z[i]). Its end, and every state in between, is z + sum(w[i] Z[i]). Given lambda = dJ/dz+ and
 * weights of states in between, in lanes of functionals, with g for the integrated outputs:
 *
 *     right_i = w_i lambda + ... + g_z(Y_i)^T gamma_i,  gamma_i = h a_3i lambda_g,
 *     sum_j (A^-1)_ji mu_j/h - f_z(Y_i)^T mu_i = right_i,
 *     lambda <- lambda + ... + sum f_z(Y_i)^T mu_i + g_z(Y_i)^T gamma_i,  gradient += f_p(Y_i)^T mu_i + g_p(Y_i)^T gamma_i.
 *
 * These are the transposed equations of the stages' derivatives. The equations are solved in rounds: approximate factors reduce
 * the residual; then exact transposes give the new residual, and contributions to the gradient. In small systems, the factors are
 * those of the Jacobians at all three stages, so the first round reduces the residual to rounding. In large systems, they are those
 * of one Jacobian, at the middle of this step or of a later one. */
#include "backwards.h"
#include "radau.h"

#include <math.h>
#include <string.h>

enum {
    ROUNDS = 60,
    LARGEST_FORMED = 32,      /* largest order of a system whose Jacobians at the stages are formed immediately */
    OLD = 0, FRESH, FORMED    /* kinds of factors: of an earlier step, of this step, of the stages' own Jacobians */
};

/* Relative change in a round below which the solution has converged. */
static const scalar FOUND = 1e-13;

/* For each kind of factors: slowest decrease of changes per round; and change at which rounding may prevent a further decrease. */
static const scalar SLOW[] = {0.1, 0.5, 0.5}, ROUNDED[] = {1e-14, 1e-14, 1e-9};

/* The relative change of the solution, the largest of all lanes, separately for coordinates and for speeds. In `loose`, the size of each
 * includes the effect of the other within the step, so that negligible entries need less accuracy. NaN if changes are not finite. */
static scalar relative(const ordernm_adjoint *a, scalar h, scalar *const *change, scalar *const *mu, scalar *loose)
{
    const ordernm_motion *const m = a->motion;
    const int width = a->width, parts[] = {0, m->system->nfree_q, m->ny};
    scalar size[2][LANES] = {{0.0}}, moved[2][LANES] = {{0.0}}, largest = 0.0;
    for (int part = 0; part < 2; ++part)
        for (int j = 0; j < STAGES; ++j)
            for (int i = parts[part]; i < parts[part + 1]; ++i)
                for (int l = 0; l < width; ++l) {
                    const scalar x = change[j][i*width + l], y = mu[j][i*width + l] + x;
                    size[part][l] += y*y;
                    moved[part][l] += x*x;
                }
    *loose = 0.0;
    for (int l = 0; l < width; ++l) {
        const scalar other[] = {size[0][l] + size[1][l]/(h*h), size[1][l] + h*h*size[0][l]};
        for (int part = 0; part < 2; ++part) {
            if (moved[part][l] == 0.0) continue;
            const scalar x = moved[part][l]/size[part][l], y = moved[part][l]/other[part];
            if (x != x || y != y) return NAN;
            largest = fmax(largest, x);
            *loose = fmax(*loose, y);
        }
    }
    *loose = sqrt(*loose);
    return sqrt(largest);
}

/* Solves the equations by factors of the given kind. Returns the status of a function, or DIVERGED if a matrix is singular. */
static int solve(ordernm_adjoint *a, scalar h, int factors, scalar *const *right, scalar *const *found)
{
    ordernm_motion *const m = a->motion;
    struct radau *const r = m->radau;
    const scalar t = m->t;
    if (factors == FORMED) {
        for (int i = 0; i < STAGES && !r->formed_here; ++i) {
            const int status = ordernm_radau_differentiate(m, ordernm_time_of_stage(t, h, i), a->stage[i], r->at_stage[i], 0);
            if (status) return status;
        }
        if (!r->formed_here && ordernm_radau_factorise_stages(r, h)) return DIVERGED;
        r->formed_here = 1;
        for (int i = 0; i < STAGES; ++i) memcpy(found[i], right[i], (long)m->ny*a->width*sizeof(scalar));
        ordernm_radau_solve_transposed(r, h, found, a->width);
        return 0;
    }
    if (!r->accepted || (factors == FRESH && !r->jacobian_here)) {
        const int status = ordernm_radau_differentiate(m, ordernm_time_of_stage(t, h, 1), a->stage[1], r->jacobian, 0);
        if (status) return status;
        ordernm_radau_take_jacobian(r);
        r->accepted = r->jacobian_here = 1;
    }
    if (r->h_factored != h && ordernm_radau_factorise(m, h)) return DIVERGED;
    ordernm_radau_precondition_transposed(r, right, found, a->width);
    return 0;
}

/* Solves the transposed equations in rounds. Adds the derivatives of the stages' rates, weighted by the solution, to lambda and to the
 * gradients of a group. Returns 0, the status of a function, DIVERGED or INFINITE. */
static int equations_transposed(ordernm_adjoint *a, int n, scalar h, scalar *const *right, scalar *lambda)
{
    ordernm_motion *const m = a->motion;
    const long size = (long)m->ny*a->width;
    scalar *const *const change = a->kappa + STAGES, *const *const mu = a->kappa + 2*STAGES;
    int factors = m->ny <= LARGEST_FORMED ? FORMED : OLD;
    scalar before = 0.0, loose = INFINITY;
    for (int j = 0; j < STAGES; ++j) memset(mu[j], 0, size*sizeof(scalar));
    for (int k = 0; k < ROUNDS; ++k) {
        int status = solve(a, h, factors, right, change);
        if (status && status != DIVERGED) return status;
        const scalar changed = status ? NAN : relative(a, h, change, mu, &loose);
        if (changed <= FOUND) return 0;
        if (!(changed < (before > 0.0 ? SLOW[factors]*before : INFINITY))) { /* also true for NAN, if there are no factors */
            if (loose <= ROUNDED[factors] && !status) return 0;
            if (factors == FORMED) return DIVERGED;
            factors = factors == OLD && m->radau->jacobian_here ? FORMED : factors + 1;
            before = 0.0;
            continue;
        }
        before = changed;
        for (int j = 0; j < STAGES; ++j) ordernm_accumulate(mu[j], 1.0, change[j], size);
        for (int i = 0; i < STAGES; ++i)
            for (int j = 0; j < STAGES; ++j) ordernm_accumulate(right[i], -A_INVERSE[j][i]/h, change[j], size);
        for (int i = 0; i < STAGES; ++i) {
            const scalar t = ordernm_time_of_stage(m->t, h, i);
            m->precise = m->precise_stages >> i & 1u;
            if ((status = ordernm_rates_transposed(a, n, t, a->stage[i], a->q[i], change[i], a->nu))) return status;
            if (!ordernm_all_finite(a->nu, size)) return INFINITE;
            ordernm_accumulate(right[i], 1.0, a->nu, size);
            ordernm_accumulate(lambda, 1.0, a->nu, size);
        }
    }
    return DIVERGED;
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
    for (int i = 0; i < STAGES; ++i)
        if (ordernm_any(right[i], size)) return equations_transposed(a, n, h, right, lambda);
    return 0;
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
