/* The adjoint of switches: with the adjoint lambda+ after a switch,
 *
 *     w = -(lambda+ . (f- - f+) + J_t)/g',  lambda- = lambda+ + w g_z,  gradient += w g_p,
 *
 * where J_t is the derivative of a functional with respect to the time of the switch, for an event whose output jumps there. */
#include "backwards.h"

#include <string.h>

/* The adjoint before the switches crossed at the start of the next step. The modes after these switches are in that step's row; the current
 * modes are those before. Functionals may depend on the time of the last switch. */
int ordernm_switches_transposed(ordernm_adjoint *a, scalar t, const scalar *z, const scalar *row)
{
    ordernm_motion *const m = a->motion;
    const int count = m->system->nswitches, n = m->ny + m->nx;
    const scalar *const crossed = row + count;
    int last = -1, status = 0;
    for (int k = 0; k < count; ++k)
        if (crossed[k] != 0.0) last = k;
    if (last < 0) return 0;
    scalar *const first = m->crossed;
    memcpy(first, m->modes, count*sizeof(scalar));
    for (int k = last; k >= 0 && !status; --k) {
        if (crossed[k] == 0.0) continue;
        scalar *const after = m->next, *const before = m->trial, speed;
        ordernm_modes_beside(m, row, first, k, 1);
        if ((status = ordernm_rates_of(m, t, z, after, 0, 0, RATES | INTEGRALS))) break;
        ordernm_modes_beside(m, row, first, k, 0);
        if ((status = ordernm_rates_of(m, t, z, before, 0, 0, RATES | INTEGRALS))) break;
        const int timed = k == last && a->timed >= 0;
        if (!ordernm_rates_jump(m, before, after) && !timed) continue;
        int by;
        if ((status = ordernm_timing_switch(m, t, z, before, crossed, k, &speed, &by))) break;
        for (int i = 0; i < n; ++i) before[i] -= after[i];
        for (int g = 0; g < a->ngroups && !status; ++g) status = ordernm_switch_transposed(a, g, t, z, by, before, speed, timed);
    }
    a->timed = -1;
    memcpy(m->modes, first, count*sizeof(scalar));
    memset(m->crossed, 0, count*sizeof(scalar));
    return status;
}

/* The adjoint before a step of size h that starts or ends at the zero of a root, see powers.c: the formula above, with f+ at the end of the step. */
int ordernm_root_transposed(ordernm_adjoint *a, int k, scalar h)
{
    ordernm_motion *const m = a->motion;
    const int n = m->ny + m->nx;
    scalar *const end = m->next, *const jump = m->rate[0], *const after = m->rate[1], speed;
    int status = ordernm_rates_of(m, m->t, m->z, jump, 0, 0, RATES | INTEGRALS);
    if (status || (status = ordernm_switch_speed(m, m->t, m->z, jump, k, &speed))) return status;
    for (long i = 0; i < m->values; ++i) end[i] = a->has_next && i < n + m->nd ? a->next[i] : m->z[i] + h*jump[i];
    if ((status = ordernm_rates_of(m, m->t + h, end, after, 0, 0, RATES | INTEGRALS))) return status;
    for (int i = 0; i < n; ++i) jump[i] -= after[i];
    for (int g = 0; g < a->ngroups && !status; ++g) {
        while (ordernm_samples_left(a, g) && !status) {
            status = ordernm_sample_transposed(a, g, a->gradients->times[a->sampled[g] - 1], end, a->nu);
            ordernm_accumulate(a->lambda + (long)g*a->n*a->width, 1.0, a->nu, (long)a->n*a->width);
        }
        if (!status) status = ordernm_switch_transposed(a, g, m->t, m->z, k, jump, speed, 0);
    }
    return status;
}
