/* The transposed equations of Radau IIA's stages, for right sides in lanes:
 *
 *     sum_j (A^-1)_ji mu_j/h - f_z(Y_i)^T mu_i = right_i.
 *
 * They are solved in rounds: approximate factors reduce the residual; then exact transposes give the new residual, and contributions to
 * the gradient. In small systems, the factors are those of the Jacobians at all three stages, so the first round reduces the residual to
 * rounding. In large systems, they are those of one Jacobian, at the middle of this step or of a later one. */
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

typedef ordernm_transposed transposed;

/* The relative change of the solution, the largest of all lanes, separately for coordinates and for speeds. In `loose`, the size of each
 * includes the effect of the other within the step, so that negligible entries need less accuracy. NaN if changes are not finite. */
static scalar relative(const transposed *e, scalar *loose)
{
    const ordernm_motion *const m = e->motion;
    const scalar h = e->h;
    const int width = e->width, parts[] = {0, m->system->nfree_q, m->ny};
    scalar size[2][LANES] = {{0.0}}, moved[2][LANES] = {{0.0}}, largest = 0.0;
    for (int part = 0; part < 2; ++part)
        for (int j = 0; j < STAGES; ++j)
            for (int i = parts[part]; i < parts[part + 1]; ++i)
                for (int l = 0; l < width; ++l) {
                    const long k = e->at + (long)i*width + l;
                    const scalar x = e->change[j][k], y = e->mu[j][k] + x;
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
static int solve(const transposed *e, int factors)
{
    ordernm_motion *const m = e->motion;
    struct radau *const r = m->radau;
    const scalar t = m->t, h = e->h;
    scalar *right[STAGES], *found[STAGES];
    for (int i = 0; i < STAGES; ++i) right[i] = e->right[i] + e->at, found[i] = e->change[i] + e->at;
    if (factors == FORMED) {
        for (int i = 0; i < STAGES && !r->formed_here; ++i) {
            const int status = ordernm_radau_differentiate(m, ordernm_time_of_stage(t, h, i), e->stage[i], r->at_stage[i], 0);
            if (status) return status;
        }
        if (!r->formed_here && ordernm_radau_factorise_stages(r, h)) return DIVERGED;
        r->formed_here = 1;
        for (int i = 0; i < STAGES; ++i) memcpy(found[i], right[i], (long)m->ny*e->width*sizeof(scalar));
        ordernm_radau_solve_transposed(r, h, found, e->width);
        return 0;
    }
    if (!r->accepted || (factors == FRESH && !r->jacobian_here)) {
        const int status = ordernm_radau_differentiate(m, ordernm_time_of_stage(t, h, 1), e->stage[1], r->jacobian, 0);
        if (status) return status;
        ordernm_radau_take_jacobian(r);
        r->accepted = r->jacobian_here = 1;
    }
    if (r->h_factored != h && ordernm_radau_factorise(m, h)) return DIVERGED;
    ordernm_radau_precondition_transposed(r, right, found, e->width);
    return 0;
}

/* Solves the transposed equations in rounds. Adds the derivatives of the stages' rates, weighted by the solution, to lambda and to the
 * gradients. Returns 0, the status of a function, DIVERGED or INFINITE. */
int ordernm_radau_solve_adjoint(const transposed *e)
{
    ordernm_motion *const m = e->motion;
    const long size = (long)m->ny*e->width, at = e->at;
    int factors = m->ny <= LARGEST_FORMED ? FORMED : OLD, some = 0;
    scalar before = 0.0, loose = INFINITY;
    for (int j = 0; j < STAGES; ++j) {
        memset(e->mu[j] + at, 0, size*sizeof(scalar));
        for (long k = at; k < at + size && !some; ++k) some = e->right[j][k] != 0.0;
    }
    for (int k = 0; k < ROUNDS && some; ++k) {
        int status = solve(e, factors);
        if (status && status != DIVERGED) return status;
        const scalar changed = status ? NAN : relative(e, &loose);
        if (changed <= FOUND) return 0;
        if (!(changed < (before > 0.0 ? SLOW[factors]*before : INFINITY))) { /* also true for NAN, if there are no factors */
            if (loose <= ROUNDED[factors] && !status) return 0;
            if (factors == FORMED) return DIVERGED;
            factors = factors == OLD && m->radau->jacobian_here ? FORMED : factors + 1;
            before = 0.0;
            continue;
        }
        before = changed;
        for (int i = 0; i < STAGES; ++i) {
            for (long n = at; n < at + size; ++n) e->mu[i][n] += e->change[i][n];
            for (int j = 0; j < STAGES; ++j)
                for (long n = at; n < at + size; ++n) e->right[i][n] -= A_INVERSE[j][i]/e->h*e->change[j][n];
        }
        for (int i = 0; i < STAGES; ++i) {
            if ((status = e->rates_transposed(e, i))) return status;
            if (!ordernm_all_finite(e->nu + at, size)) return INFINITE;
            for (long n = at; n < at + size; ++n) e->right[i][n] += e->nu[n];
            for (long n = at; n < at + size; ++n) e->lambda[n] += e->nu[n];
        }
    }
    return some ? DIVERGED : 0;
}
