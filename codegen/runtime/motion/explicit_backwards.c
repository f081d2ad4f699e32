/* The adjoint of a step of an explicit method.
 *
 * A step is Y_i = z + h sum a_ij k_j, k_i = f(Y_i), z+ = z + h sum b_j k_j. Given lambda = dJ/dz+ in lanes of functionals, and
 * weights of states between the ends, which are sums of the same rates:
 *
 *     kappa_j = h (b_j lambda + sum_i>j a_ij nu_i),  nu_j = f_z(Y_j)^T kappa_j,  gradient += f_p(Y_j)^T kappa_j,
 *     lambda <- lambda + sum nu_j. */
#include "backwards.h"

#include <string.h>

/* The first rate of a step, from the end of the step's row. A recomputed rate would differ by rounding, which is large near a pose where a
 * loop loses rank. */
static void first_rate(ordernm_motion *m, const scalar *step)
{
    const long state = m->ny + m->nx + m->nd;
    memcpy(m->rate[0], step + ordernm_step_size(m->problem) - state, state*sizeof(scalar));
}

/* Repeats the stages of the original step, and the rates at these stages if they are needed. */
static int stages(ordernm_adjoint *a, const scalar *step, int count)
{
    ordernm_motion *const m = a->motion;
    const scheme *const method = m->method;
    const scalar h = step[1];
    first_rate(m, step);
    ordernm_expand(m, m->z); /* loops are already closed at the start of a step */
    memcpy(a->stage[0], m->z, m->values*sizeof(scalar));
    if (!m->identity) memcpy(a->q[0], m->q, m->system->nq*sizeof(scalar));
    for (int i = 1; i < count; ++i) {
        const row *const r = method->rows + i;
        ordernm_combine(m->values, a->stage[i], m->z, h, r->count, r->which, r->factor, m->rate);
        const scalar t = m->t + method->times[i]*h;
        const int status = ordernm_rates(m, t, a->stage[i], m->rate[i]);
        if (status) return status;
        ordernm_note_precise(m, i);
        if (!m->identity) memcpy(a->q[i], m->q, m->system->nq*sizeof(scalar));
    }
    return 0;
}

/* States and rates at the stages of a step, from its row in the list of steps. */
static void stages_kept(ordernm_adjoint *a, const scalar *step)
{
    ordernm_motion *const m = a->motion;
    const long state = m->ny + m->nx + m->nd, nq = m->identity ? 0 : m->system->nq;
    const scalar *at = step + m->head + state;
    memcpy(a->stage[0], m->z, state*sizeof(scalar));
    memcpy(a->q[0], m->q, nq*sizeof(scalar));
    for (int i = 1; i < m->method->stages; ++i, at += state + nq) {
        memcpy(a->stage[i], at, state*sizeof(scalar));
        memcpy(a->q[i], at + state, nq*sizeof(scalar));
    }
}

/* The adjoint of one step for one group of functionals: lambda at the end of the step becomes lambda at its start. */
static int group_backwards(ordernm_adjoint *a, int n, scalar h, int within)
{
    ordernm_motion *const m = a->motion;
    const scheme *const method = m->method;
    const long size = (long)a->n*a->width;
    scalar *const lambda = a->lambda + n*size;
    const row *const end = method->rows + method->stages;
    const int count = within ? method->all : method->stages;
    int status;
    for (int i = 0; i < count; ++i) memset(a->kappa[i], 0, size*sizeof(scalar));
    for (int j = 0; j < end->count; ++j) ordernm_accumulate(a->kappa[end->which[j]], h*end->factor[j], lambda, size);
    while (ordernm_samples_left(a, n)) {
        const scalar at = a->gradients->times[a->sampled[n] - 1];
        scalar factor[MOST_STAGES];
        static const int every[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
        method->weights((at - m->t)/h, factor);
        ordernm_combine(m->values, m->trial, m->z, h, method->all, every, factor, m->rate);
        if ((status = ordernm_sample_transposed(a, n, at, m->trial, a->nu))) return status;
        ordernm_accumulate(lambda, 1.0, a->nu, size);
        for (int j = 0; j < method->all; ++j) ordernm_accumulate(a->kappa[j], h*factor[j], a->nu, size);
    }
    for (int i = count - 1; i >= 0; --i) {
        if (!ordernm_any(a->kappa[i], size)) continue;
        const row *const r = method->rows + i;
        const scalar t = m->t + method->times[i]*h;
        m->precise = m->precise_stages >> i & 1u;
        if ((status = ordernm_rates_transposed(a, n, t, a->stage[i], a->q[i], a->kappa[i], a->nu))) return status;
        if ((status = ordernm_integrals_transposed(a, n, t, a->stage[i], a->q[i], a->kappa[i], a->nu))) return status;
        ordernm_accumulate(lambda, 1.0, a->nu, size);
        for (int j = 0; j < r->count; ++j) ordernm_accumulate(a->kappa[r->which[j]], h*r->factor[j], a->nu, size);
    }
    return 0;
}

int ordernm_explicit_backwards(ordernm_adjoint *a, const scalar *step)
{
    ordernm_motion *const m = a->motion;
    const scalar h = step[1];
    int within = 0, status;
    m->precise_stages = (unsigned)step[2];
    for (int n = 0; n < a->ngroups; ++n) within |= ordernm_samples_left(a, n);
    if (within || m->system->split) {
        if ((status = stages(a, step, within ? m->method->all : m->method->stages))) return status;
    } else {
        ordernm_expand(m, m->z); /* the first stage is the start of the step, where loops are already closed */
        stages_kept(a, step);
    }
    if (m->system->split) {
        const row *const r = m->method->rows + m->method->stages;
        ordernm_combine(m->values, m->next, m->z, h, r->count, r->which, r->factor, m->rate);
        if ((status = ordernm_settling_transposed(a, m->t + h, m->next))) return status;
    }
    for (int n = 0; n < a->ngroups; ++n)
        if ((status = group_backwards(a, n, h, within))) return status;
    return 0;
}

int ordernm_explicit_replay(ordernm_motion *m, int first, scalar *step)
{
    if (first) {
        first_rate(m, step);
        m->precise_stages = (unsigned)step[2];
    }
    const scheme *const method = m->method;
    const row *const end = method->rows + method->stages;
    const scalar h = step[1];
    for (int i = 1; i < method->stages; ++i) {
        const row *const r = method->rows + i;
        ordernm_combine(m->size, m->trial, m->z, h, r->count, r->which, r->factor, m->rate);
        const int status = ordernm_rates(m, m->t + method->times[i]*h, m->trial, m->rate[i]);
        if (status) return status;
        ordernm_keep_stage(m, i);
    }
    ordernm_combine(m->size, m->next, m->z, h, end->count, end->which, end->factor, m->rate);
    return 0;
}
