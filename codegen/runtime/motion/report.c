/* Rows of results at a state. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* Time derivatives of all coordinates (with normalised quaternions), speeds and outputs. */
int ordernm_report_rates(ordernm_motion *m, scalar t, const scalar *z, scalar *rates)
{
    const ordernm_system *const s = m->system;
    scalar *const qdot = rates, *const udot = qdot + s->nq, *const outputs = udot + s->nu;
    int status = ordernm_rates_of(m, t, z, m->trial, 0, 0, RATES);
    if (status) return status;
    memcpy(qdot, m->identity ? m->trial : m->qdot, s->nq*sizeof(scalar));
    memcpy(udot, m->identity ? m->trial + s->nq : m->udot, s->nu*sizeof(scalar));
    const scalar *const q = m->identity ? z : m->q;
    for (int i = 0; i < s->nquaternions; ++i) {
        scalar e[4];
        memcpy(e, q + s->quaternion[i], sizeof e);
        ordernm_normalise(e, qdot + s->quaternion[i], 1);
    }
    for (int i = 0; i < s->noutputs; ++i) outputs[i] = NAN;
    if (!s->output_sensitivities[ORDERNM_ONE]) return 0;
    ordernm_call c;
    if ((status = ordernm_along_time(m, t, z, m->trial, &c))) return status;
    c.outputs = m->outputs, c.doutputs = m->doutputs;
    if ((status = ORDERNM_OF(m, output_sensitivities[ORDERNM_ONE])(&c))) return status;
    memcpy(outputs, m->doutputs, s->noutputs*sizeof(scalar));
    return 0;
}

/* Derivatives along the directions of a group, in a row of results that already contains the values. */
static int report_along(ordernm_motion *m, scalar t, const scalar *z, const group *g, ordernm_call *c, scalar *row)
{
    const ordernm_system *const s = m->system;
    const long n = m->problem->ndirections, nq = s->nq, nu = s->nu, ny = s->noutputs, nx = m->nx;
    scalar *const dq = row + 1 + nq + nu + ny + nx, *const du = dq + n*nq, *const dy = du + n*nu, *const dx = dy + n*ny;
    const scalar *const S = z + g->at, *const lost = m->lost + (g - m->groups)*LANES;
    const int width = g->width;
    int status;
    ordernm_seeds(m, t, z, g, c);
    scalar *of_q = c->dq, *of_u = c->du;
    if (!m->identity) {
        c->full_u = m->qdot;
        c->dfull_q = of_q = m->full_dq;
        c->dfull_u = of_u = m->full_du;
        if ((status = ORDERNM_OF(m, completion_sensitivities[g->index])(c))) return status;
    } else if (s->nquaternions) {
        memcpy(m->full_dq, of_q, nq*width*sizeof(scalar));
        of_q = m->full_dq;
    }
    for (int i = 0; i < s->nquaternions; ++i) {
        scalar e[4];
        memcpy(e, c->q + s->quaternion[i], sizeof e);
        ordernm_normalise(e, of_q + s->quaternion[i]*width, width);
    }
    if (ny && s->output_sensitivities[g->index]) {
        c->outputs = m->outputs;
        c->doutputs = m->doutputs;
        if ((status = ORDERNM_OF(m, output_sensitivities[g->index])(c))) return status;
    }
    for (int l = 0; l < g->used; ++l) {
        const long k = g->first + l;
        for (int i = 0; i < nq; ++i) dq[k*nq + i] = lost[l] + of_q[i*width + l];
        for (int i = 0; i < nu; ++i) du[k*nu + i] = lost[l] + of_u[i*width + l];
        for (int i = 0; i < ny; ++i) dy[k*ny + i] = lost[l] + m->doutputs[i*width + l];
        for (int i = 0; i < nx; ++i) dx[k*nx + i] = lost[l] + S[(m->ny + i)*width + l];
    }
    return 0;
}

/* A row of results at a state, with closed loops and normalised quaternions. */
int ordernm_report(ordernm_motion *m, scalar t, const scalar *z, scalar *row)
{
    const ordernm_system *s = m->system;
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    int status = ordernm_close_loops(m, &c);
    if (status) return status;
    scalar *q = row + 1, *u = q + s->nq, *outputs = u + s->nu, *integrals = outputs + s->noutputs;
    row[0] = t;
    memcpy(q, c.q, s->nq*sizeof(scalar));
    memcpy(u, c.u, s->nu*sizeof(scalar));
    for (int i = 0; i < s->nquaternions; ++i) ordernm_normalise(q + s->quaternion[i], 0, 0);
    if (!m->identity) {
        c.full_u = u;
        if ((status = ORDERNM_OF(m, completion)(&c))) return status;
    }
    if (s->noutputs && s->outputs) {
        c.outputs = outputs;
        if ((status = ORDERNM_OF(m, outputs)(&c))) return status;
    }
    for (int i = 0; i < m->nx; ++i) integrals[i] = z[m->ny + i];
    for (int n = 0; n < m->ngroups && !status; ++n) status = report_along(m, t, z, m->groups + n, &c, row);
    return status;
}

/* An event's row at a state: a row of results, and the time derivatives of coordinates, speeds and outputs in the current modes. */
int ordernm_describe(ordernm_motion *m, scalar t, const scalar *z, scalar *row)
{
    const int status = ordernm_report(m, t, z, row);
    return status ? status : ordernm_report_rates(m, t, z, row + ordernm_row_size(m->problem));
}
