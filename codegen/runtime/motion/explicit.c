/* Explicit Runge-Kutta methods: a step, its error, and the interpolant.
 *
 * Every stage, the step's end and all interpolated states are sums z + h*sum(factor*rate), where the factors of an interpolant
 * depend on the position. Derivatives and the adjoint follow directly. */
#include "inside.h"

#include "explicit_tables.h"

#include <string.h>

static void stage(ordernm_motion *m, const row *r, scalar h, scalar *z)
{
    ordernm_combine(m->size, z, m->z, h, r->count, r->which, r->factor, m->rate);
}

/* If steps are stored for the adjoint, stores the state of a stage, too; the adjoint then need not repeat the rates. */
void ordernm_keep_stage(ordernm_motion *m, int i)
{
    if (!m->results->steps) return;
    ordernm_note_precise(m, i);
    const long state = m->ny + m->nx + m->nd, nq = m->identity ? 0 : m->system->nq;
    scalar *const at = m->stages + (i - 1)*(state + nq);
    memcpy(at, m->trial, state*sizeof(scalar));
    memcpy(at + state, m->q, nq*sizeof(scalar));
}

static void keep(const ordernm_motion *m, scalar *row)
{
    const long state = m->ny + m->nx + m->nd, begins = m->head + state, ends = ordernm_step_size(m->problem) - state;
    row[2] = m->precise_stages;
    row[3] = 0.0;
    memcpy(row + begins, m->stages, (ends - begins)*sizeof(scalar));
    memcpy(row + ends, m->rate[0], state*sizeof(scalar));
}

static const int every[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};

/* Rates at some stages; from the second stage on, records condition numbers and stores states. */
static int stages(ordernm_motion *m, scalar h, int from, int to)
{
    for (int i = from; i < to; ++i) {
        stage(m, m->method->rows + i, h, m->trial);
        const int status = ordernm_rates(m, m->t + m->method->times[i]*h, m->trial, m->rate[i]);
        if (from == 1) ordernm_note_condition(m, i, status);
        if (status) return status;
        if (from == 1) ordernm_keep_stage(m, i);
    }
    return 0;
}

static int complete(ordernm_motion *m, scalar h) { return stages(m, h, m->method->stages + 1, m->method->all); }

static void interpolate(ordernm_motion *m, scalar h, scalar theta, scalar *z)
{
    scalar w[16];
    m->method->weights(theta, w);
    ordernm_combine(m->size, z, m->z, h, m->method->all, every, w, m->rate);
}

/* A step without an error estimate. */
static int to_end(ordernm_motion *m, scalar h)
{
    const int status = stages(m, h, 1, m->method->stages);
    if (!status) stage(m, m->method->rows + m->method->stages, h, m->next);
    return status;
}

/* ---- Dormand and Prince's method of order 8. ---- */

static int dop853_step(ordernm_motion *m, scalar h, scalar *error)
{
    const int status = to_end(m, h);
    if (status) return status;
    const long n = m->problem->atol_directions ? m->size : m->values;
    ordernm_combine(n, m->error[0], m->zeros, h, 12, every, dop853_error5, m->rate);
    ordernm_combine(n, m->error[1], m->zeros, h, 12, every, dop853_error3, m->rate);
    *error = ordernm_error_norm(m, m->next, m->error[0], m->error[1]);
    return 0;
}

/* Factors of the rates in the state at t + theta h. */
static void dop853_weights(scalar theta, scalar *w)
{
    const scalar x = theta, y = 1.0 - theta;
    for (int i = 0; i < 16; ++i) {
        w[i] = y*(dop853_dense[0][i] + x*(dop853_dense[1][i] + y*(dop853_dense[2][i] + x*dop853_dense[3][i])));
        w[i] = i == 0 || i == 12 ? w[i] - 1.0 : w[i];
    }
    const row *end = dop853_rows + 12;
    for (int j = 0; j < end->count; ++j) w[end->which[j]] += 2.0*end->factor[j];
    for (int i = 0; i < 16; ++i) w[i] *= x;
    for (int j = 0; j < end->count; ++j) w[end->which[j]] -= end->factor[j];
    w[0] += 1.0;
    for (int i = 0; i < 16; ++i) w[i] *= y;
    for (int j = 0; j < end->count; ++j) w[end->which[j]] += end->factor[j];
    for (int i = 0; i < 16; ++i) w[i] *= x;
}

const scheme ordernm_dop853 = {DOP853_STAGES, 16, 8, dop853_step, complete, interpolate, dop853_rows, dop853_times,
    dop853_weights, 0, 0.4667, keep};

/* ---- The classical method of order 4. ---- */

static int rk4_step(ordernm_motion *m, scalar h, scalar *error)
{
    *error = 0.0;
    return to_end(m, h);
}

/* Factors of the rates in the state at t + theta h, by Hermite's cubic. */
static void rk4_weights(scalar theta, scalar *w)
{
    const scalar x = theta, y = 1.0 - theta;
    for (int i = 0; i < 4; ++i) w[i] = x*x*(3.0 - 2.0*x)*rk4_rows[4].factor[i];
    w[0] += x*y*y;
    w[4] = -x*x*y;
}

const scheme ordernm_rk4 = {RK4_STAGES, 5, 5, rk4_step, complete, interpolate, rk4_rows, rk4_times, rk4_weights, 0, 0.25, keep};
