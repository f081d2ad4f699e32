/* A step of an explicit method with tangents, and its adjoint with tangents.
 *
 * With the notation of explicit_backwards.c, and d for changes along a direction,
 *
 *     dY_i = dz + h sum a_ij dk_j,  dkappa_j = h (b_j dlambda + sum_i>j a_ij dnu_i),
 *     dnu_j = f_z(Y_j)^T dkappa_j + (f_zz dY_j + f_zp dp)^T kappa_j,  dlambda <- dlambda + sum dnu_j.
 *
 * One function computes both terms of dnu_j and f_z^T kappa. */
#include "curvature.h"

#include <string.h>

/* Writes the dependent coordinates of a stage after the first, which are stored with the step, to its state. */
static void take_closed(const ordernm_motion *m, const scalar *step, int stage, scalar *z)
{
    const long state = m->ny + m->nx + m->nd, nq = m->system->nq;
    const scalar *const q = step + m->head + stage*(state + nq) + state - nq;
    for (int i = 0; i < m->nd; ++i) z[m->ny + m->nx + i] = q[m->dependent[i]];
}

int ordernm_explicit_along(ordernm_curvature *c, const scalar *step, scalar until, scalar *records, scalar *nodes)
{
    const scalar h = step[1];
    ordernm_motion *const m = c->motion;
    const scheme *const method = m->method;
    const row *const end = method->rows + method->stages;
    const long record = ordernm_hessians_record(c);
    const int within = c->next < c->found->ntimes && c->found->times[c->next] <= until;
    int status;
    m->precise_stages = (unsigned)step[2];
    for (int i = 0; i < (within ? c->all : method->stages); ++i) {
        const row *const r = method->rows + i;
        if (i) ordernm_combine(m->size, m->trial, m->z, h, r->count, r->which, r->factor, m->rate);
        scalar *const z = i ? m->trial : m->z;
        const int stored = i < method->stages ? i : -1;
        if (stored > 0 && !m->identity) take_closed(m, step, i, z);
        if ((status = ordernm_rates_and_keep(c, m->t + method->times[i]*h, z, m->rate[i], stored, records + i*record))) return status;
        nodes[2*i] = m->t + method->times[i]*h;
    }
    if (within && (status = ordernm_states_within(c, h, until))) return status;
    for (int j = 0; j < end->count; ++j) nodes[2*end->which[j] + 1] = h*end->factor[j];
    ordernm_combine(m->size, m->next, m->z, h, end->count, end->which, end->factor, m->rate);
    return 0;
}

int ordernm_explicit_along_back(ordernm_curvature *c, scalar h, const scalar *records, const scalar *integrands)
{
    ordernm_motion *const m = c->motion;
    const scheme *const method = m->method;
    const row *const end = method->rows + method->stages;
    const long record = ordernm_hessians_record(c);
    scalar weight[MOST_STAGES] = {0.0};
    int status;
    for (int i = 0; i < c->all; ++i) memset(c->kappa[i], 0, m->size*sizeof(scalar));
    for (int j = 0; j < end->count; ++j) {
        weight[end->which[j]] = h*end->factor[j];
        ordernm_add_to(c->kappa[end->which[j]], h*end->factor[j], c->lambda, m->size);
    }
    ordernm_samples_back(c, h, method->weights, c->all, h);
    for (int i = c->all - 1; i >= 0; --i) {
        const row *const r = method->rows + i;
        const scalar t = m->t + method->times[i]*h, *const kappa = c->kappa[i];
        const int integrand = integrands && weight[i] != 0.0, weighted = ordernm_some(kappa, m->size);
        if (!integrand && !weighted) continue;
        ordernm_pack(c, records + i*record, m->trial);
        memset(c->nu, 0, m->size*sizeof(scalar));
        if (weighted && (status = ordernm_gradients_along(c, t, m->trial, records + i*record, kappa, c->nu, 1))) return status;
        if (integrand) ordernm_add_source(c, t, weight[i], integrands + i*ordernm_source_size(c), c->nu);
        ordernm_add_to(c->lambda, 1.0, c->nu, m->size);
        for (int j = 0; j < r->count; ++j) ordernm_add_to(c->kappa[r->which[j]], h*r->factor[j], c->nu, m->size);
    }
    return 0;
}
