/* Hessian products of functionals by the discrete adjoint, along directions: tangents of the original steps forwards, then the adjoint
 * and its tangents backwards. */
#include "curvature.h"

#include <math.h>
#include <string.h>

static size_t lay_out(ordernm_curvature *c, const ordernm_problem *problem, long size)
{
    const ordernm_system *const s = problem->system;
    memory of = {(char *)c, 0};
    ordernm_curvature none;
    ordernm_take(&of, sizeof none);
    if (!c) c = &none;
    c->lambda = ordernm_numbers(&of, size);
    c->nu = ordernm_numbers(&of, size);
    for (int i = 0; i < MOST_STAGES; ++i) c->kappa[i] = ordernm_numbers(&of, size);
    gradient *const both[] = {&c->along, &c->values};
    for (int i = 0; i < 2; ++i) {
        gradient *const g = both[i];
        const long lanes = i ? 1 : LANES;
        g->q = ordernm_numbers(&of, s->nq*lanes);
        g->u = ordernm_numbers(&of, s->nu*lanes);
        g->p = ordernm_numbers(&of, s->np*lanes);
        g->inputs = ordernm_numbers(&of, s->ninputs*lanes);
        g->t = ordernm_numbers(&of, lanes);
    }
    c->no_dt = ordernm_numbers(&of, LANES);
    c->p = ordernm_numbers(&of, s->np*(problem->ndirections + LANES));
    c->b = ordernm_numbers(&of, s->nu);
    c->db = ordernm_numbers(&of, s->nu*LANES);
    if (s->nswitches) {
        const long row = s->nfree_q + s->nfree_u + s->np + s->ninputs + 1L;
        c->before = ordernm_numbers(&of, size);
        c->jump = ordernm_numbers(&of, size);
        c->next_switch = ordernm_numbers(&of, 2*row + 2);
        c->one = ordernm_numbers(&of, s->nswitches);
        c->of_switch = ordernm_numbers(&of, ROWS_OF_A_SWITCH*row + LANES*row + (1L + problem->ndirections)*(row + s->ninputs));
    }
    c->rate_weights = ordernm_numbers(&of, s->nq);
    c->dqdot = ordernm_numbers(&of, s->nq*LANES);
    return of.used;
}

/* An upper bound of the size of a state with derivatives. */
static long most(const ordernm_problem *p)
{
    const long n = p->system->nq + p->system->nu + p->nintegrals;
    return ordernm_whole_lines(n) + (p->ndirections + LANES)*ordernm_whole_lines(n);
}

long ordernm_hessians_room(const ordernm_problem *problem)
{
    return 8 + (long)(lay_out(0, problem, most(problem))/sizeof(scalar)) + ordernm_room(problem);
}

ordernm_curvature *ordernm_hessians_begin(const ordernm_problem *problem, ordernm_hessians *found, scalar *room)
{
    ordernm_curvature *const c = (ordernm_curvature *)ordernm_line(room);
    const size_t used = lay_out(0, problem, most(problem));
    memset(c, 0, used);
    lay_out(c, problem, most(problem));
    c->problem = *problem;
    c->found = found;
    c->motion = ordernm_begin(&c->problem, (scalar *)((char *)c + used));
    c->motion->results = &c->none;
    c->n = problem->system->nfree_q + problem->system->nfree_u;
    c->all = c->motion->radau ? c->motion->method->stages : c->motion->method->all;
    return c;
}

int ordernm_hessians_stages(const ordernm_curvature *c) { return c->all; }

/* ---- Forwards. ---- */

int ordernm_tangents(ordernm_curvature *c, const scalar *steps, long count, scalar until, scalar *stages, scalar *nodes)
{
    ordernm_motion *const m = c->motion;
    const long size = ordernm_step_size(m->problem), record = ordernm_hessians_record(c);
    int status;
    for (long k = 0; k < count; ++k, steps += size, stages += c->all*record, nodes += 2*c->all) {
        const scalar h = steps[1], to = k + 1 < count ? steps[size] : until;
        m->t = steps[0];
        memcpy(m->z, steps + m->head, (m->ny + m->nx + m->nd)*sizeof(scalar));
        if (!(h > 0.0)) continue;
        ordernm_find_segment(m, m->t, h);
        if (!m->identity) ordernm_take_derivatives(m, steps[4]);
        if ((status = ordernm_switches_along(c, steps + ORDERNM_STEP_HEAD))) return status;
        if (m->t == m->problem->start && (status = ordernm_look_at_begin(c))) return status;
        if (c->next < c->found->ntimes && c->found->times[c->next] <= m->t) { /* only at the motion's start */
            if ((status = ordernm_close_and_keep(c, m->t, m->z, c->found->states + c->next*record))) return status;
            ++c->next;
        }
        status = m->radau ? ordernm_radau_step_along(c, steps, to, stages, nodes) : ordernm_explicit_along(c, steps, to, stages, nodes);
        if (status) return status;
        ordernm_exchange(&m->z, &m->next);
    }
    return 0;
}

void ordernm_hessians_keep(const ordernm_curvature *c, scalar *before)
{
    before[0] = c->next, before[1] = c->passed;
    memcpy(before + 2, c->motion->modes, c->motion->system->nswitches*sizeof(scalar));
    ordernm_unpack(c, c->motion->z, before + 2 + c->motion->system->nswitches);
}

void ordernm_hessians_take(ordernm_curvature *c, const scalar *before)
{
    c->next = (long)before[0], c->passed = (long)before[1];
    memcpy(c->motion->modes, before + 2, c->motion->system->nswitches*sizeof(scalar));
    ordernm_pack(c, before + 2 + c->motion->system->nswitches, c->motion->z);
}

int ordernm_hessians_state(ordernm_curvature *c, scalar t, scalar *to) { return ordernm_close_and_keep(c, t, c->motion->z, to); }

int ordernm_hessians_integrands(ordernm_curvature *c, const scalar *steps, long count, const scalar *stages, const scalar *nodes,
    scalar *sources)
{
    ordernm_motion *const m = c->motion;
    const long record = ordernm_hessians_record(c), source = ordernm_source_size(c);
    for (long k = 0; k < count; ++k, steps += ordernm_step_size(m->problem)) {
        if (!(steps[1] > 0.0)) continue;
        ordernm_find_segment(m, steps[0], steps[1]);
        ordernm_take_modes(m, steps + ORDERNM_STEP_HEAD);
        for (long i = k*c->all; i < (k + 1)*c->all; ++i) {
            if (nodes[2*i + 1] == 0.0) continue;
            const int status = ordernm_outputs_along(c, nodes[2*i], stages + i*record, c->found->weights, sources + i*source);
            if (status) return status;
        }
    }
    return 0;
}

/* ---- Backwards. ---- */

void ordernm_hessians_turn(ordernm_curvature *c)
{
    memset(c->lambda, 0, c->motion->size*sizeof(scalar));
    memset(c->p, 0, c->problem.system->np*(c->problem.ndirections + LANES)*sizeof(scalar));
    if (c->found->finish) ordernm_pack(c, c->found->finish, c->lambda);
    c->left = c->found->ntimes;
    c->passed_left = c->passed_all;
    if (c->next_switch) c->next_switch[2*(c->n + c->problem.system->np + c->problem.system->ninputs + 1L) + 1] = INFINITY;
}

int ordernm_hessians_backwards(ordernm_curvature *c, const scalar *steps, long count, const scalar *stages, const scalar *integrands)
{
    ordernm_motion *const m = c->motion;
    const long size = ordernm_step_size(m->problem), records = c->all*ordernm_hessians_record(c);
    for (long i = count - 1; i >= 0; --i) {
        const scalar *const step = steps + i*size;
        m->t = step[0];
        if (!(step[1] > 0.0)) continue;
        ordernm_find_segment(m, m->t, step[1]);
        ordernm_take_modes(m, step + ORDERNM_STEP_HEAD);
        const scalar *const of = integrands ? integrands + i*c->all*ordernm_source_size(c) : 0;
        int status = m->radau ? ordernm_radau_along_back(c, step[1], stages + i*records, of)
                              : ordernm_explicit_along_back(c, step[1], stages + i*records, of);
        if (!status) status = ordernm_switches_along_back(c, step + ORDERNM_STEP_HEAD);
        if (status) return status;
    }
    return 0;
}

void ordernm_hessians_end(ordernm_curvature *c)
{
    ordernm_motion *const m = c->motion;
    const ordernm_system *const s = m->system;
    for (; c->left > 0; --c->left)
        ordernm_add_source(c, m->t, 1.0, c->found->sources + (c->left - 1)*ordernm_source_size(c), c->lambda);
    ordernm_unpack(c, c->lambda, c->found->start);
    for (const group *g = m->groups; g < m->groups + m->ngroups; ++g)
        for (int l = 0; l < g->used; ++l)
            for (int i = 0; i < s->np; ++i) c->found->p[(1 + g->first + l)*s->np + i] += c->p[s->np*g->first + i*g->width + l];
}
