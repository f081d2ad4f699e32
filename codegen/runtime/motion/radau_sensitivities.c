/* Derivatives of Radau IIA's stages along the directions of a group.
 *
 * These are the derivatives of the step actually made, with S at its start: dZ[i] = h*sum(a[i][j]*D rate[j](S + dZ[j])), linear equations
 * with the exact Jacobian at every stage. For small systems, these Jacobians are formed, and the equations of all three stages are
 * factorised once for all directions; the last Jacobian is also used by Newton's method in the next step. For large systems, the equations
 * are solved in sweeps: the system's functions give the right sides along all directions of a group at once, and the existing factors
 * correct dZ in the same way as Z. If the sweeps fail, Jacobians are formed as for small systems, so that steps are the same with and
 * without directions. */
#include "radau.h"

#include <math.h>
#include <string.h>

enum { SWEEPS = 15, MOST_FORMED_FOR_FLOW = 2*LANES };

/* Change by a sweep, relative to the sensitivities, at which sweeps have converged; and the change that rounding may cause. */
static const scalar SWEPT = 1e-14, ROUNDED = 1e-12;

/* Lower bound of the convergence factor that is estimated from earlier sweeps, since small entries may converge more slowly. */
static const scalar LEAST_SLOWNESS = 1e-2;

/* The largest change of a group's derivatives relative to their size, separately for coordinates and for speeds. In `loose`, the size of
 * each includes the effect of the other within the step, so that negligible entries need less accuracy. NaN if changes are not finite. */
static scalar change_of(const ordernm_motion *m, const group *g, scalar h, scalar *loose)
{
    const struct radau *const r = m->radau;
    const int width = g->width, parts[] = {0, m->system->nfree_q, m->ny};
    scalar size[2][LANES] = {{0.0}}, change[2][LANES] = {{0.0}}, largest = 0.0;
    for (int part = 0; part < 2; ++part)
        for (int i = parts[part]; i < parts[part + 1]; ++i)
            for (int l = 0; l < width; ++l) {
                const long k = (long)i*width + l, at = g->at + k;
                const scalar S = m->z[at], end = S + r->stage[2][at];
                size[part][l] += S*S + end*end;
                for (int j = 0; j < STAGES; ++j) change[part][l] += r->right[j][k]*r->right[j][k];
            }
    *loose = 0.0;
    for (int l = 0; l < g->used; ++l) {
        const scalar other[] = {size[0][l] + h*h*size[1][l], size[1][l] + size[0][l]/(h*h)};
        for (int part = 0; part < 2; ++part) {
            if (change[part][l] == 0.0) continue;
            const scalar x = change[part][l]/size[part][l], y = change[part][l]/other[part];
            if (!(x <= largest)) largest = x;
            if (!(y <= *loose)) *loose = y;
            if (x != x || y != y) return NAN;
        }
    }
    *loose = sqrt(*loose);
    return sqrt(largest);
}

/* Forms the Jacobians at the stages, and factorises their equations. */
static int form(ordernm_motion *m, scalar h)
{
    struct radau *const r = m->radau;
    memset(r->infinite, 0, r->n*sizeof(scalar));
    for (int i = 0; i < STAGES; ++i) {
        for (long k = 0; k < m->values; ++k) m->trial[k] = m->z[k] + r->stage[i][k];
        const scalar t = ordernm_time_of_stage(m->t, h, i);
        const int status = ordernm_radau_differentiate(m, t, m->trial, r->at_stage[i], m->precise_stages >> i & 1u);
        if (status) return status;
    }
    return ordernm_radau_factorise_stages(r, h) ? DIVERGED : CONVERGED;
}

/* Whether derivatives along a direction were found, or do not exist because rates have none; if they do not exist, sets them to NaN. */
static int has_values(const struct radau *r, const group *g, int lane)
{
    int none = 0, finite = 1;
    for (int i = 0; i < STAGES; ++i) {
        const scalar *const Z = r->stage[i] + g->at;
        none |= !ordernm_finite_along(r->along[i], r->n, g->width, lane);
        finite &= ordernm_finite_along(Z, r->n, g->width, lane);
        for (int k = 0; k < r->n; ++k) none |= r->infinite[k] != 0.0 && Z[k*g->width + lane] != 0.0;
    }
    for (int k = 0; none && k < r->n; ++k) r->stage[STAGES - 1][g->at + k*g->width + lane] = NAN;
    return none || finite;
}

/* Whether finite derivatives were found along all directions of a group; almost always true. */
static int all_have_values(const struct radau *r, const group *g)
{
    const long size = (long)r->n*g->width;
    for (int i = 0; i < STAGES; ++i)
        if (!ordernm_all_finite(r->along[i], size) || !ordernm_all_finite(r->stage[i] + g->at, size)) return 0;
    for (int k = 0; k < r->n; ++k)
        if (r->infinite[k] != 0.0) return 0;
    return 1;
}

/* Derivatives of the stages along the directions of a group, by formed Jacobians. */
static int along_formed(ordernm_motion *m, scalar h, const group *g)
{
    struct radau *const r = m->radau;
    for (int i = 0; i < STAGES; ++i) {
        const int status = ordernm_radau_rates(m, h, i, g, 1, RATES | KNOWN_CLOSED);
        if (status) return status;
        memcpy(r->along[i], m->rate[i + 1] + g->at, (long)r->n*g->width*sizeof(scalar));
    }
    ordernm_radau_solve_stages(m, h, g->at, g->width);
    if (all_have_values(r, g)) return CONVERGED;
    for (int l = 0; l < g->width; ++l)
        if (!has_values(r, g, l)) return DIVERGED;
    return CONVERGED;
}

/* Solves for the derivatives at the stages along a group by sweeps, from any starting values. */
static int sweep(ordernm_motion *m, scalar h, const group *g, int closed, scalar *slowness)
{
    scalar before = 0.0;
    *slowness = pow(fmax(*slowness, ORDERNM_EPSILON), 0.8);
    for (int k = 1; k <= SWEEPS; ++k) {
        for (int i = 0; i < STAGES; ++i) {
            const int status = ordernm_radau_rates(m, h, i, g, 0, RATES | closed);
            if (status) return status;
        }
        ordernm_radau_correct(m, h, g->at, g->width);
        scalar loose;
        const scalar size = change_of(m, g, h, &loose);
        if (size != size) return DIVERGED;
        if (k > 1) {
            const scalar theta = size/before;
            if (size < INFINITY && theta < 1.0) *slowness = theta/(1.0 - theta);
            if (!(theta < 0.5) && loose <= ROUNDED) return CONVERGED;
            if (theta > 2.0 && k > 3) return DIVERGED;
        }
        if (fmax(*slowness, LEAST_SLOWNESS)*size <= SWEPT) return CONVERGED;
        before = size;
    }
    return DIVERGED;
}

/* Solves for the derivatives at the stages along a group, by sweeps or with the Jacobians at the stages. `formed`: whether another group
 * has formed these Jacobians in this step. For the direction of the motion itself, the choice does not depend on other directions. So steps
 * do not depend on other directions, either. */
int ordernm_radau_along(ordernm_motion *m, scalar h, const group *g, int closed, int *formed)
{
    struct radau *const r = m->radau;
    const int of_flow = g - m->groups == m->ngroups, by_sweeps = of_flow ? r->n > MOST_FORMED_FOR_FLOW : !r->formed && !*formed;
    int status = DIVERGED;
    if (by_sweeps) status = sweep(m, h, g, closed, of_flow ? &r->flow_slowness : &r->sweep_slowness);
    if (status != DIVERGED) return status;
    if (!*formed) {
        r->formed_here = 0;
        if ((status = form(m, h)) != CONVERGED) return status;
        *formed = 1;
    }
    return along_formed(m, h, g);
}
