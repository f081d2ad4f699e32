/* The start of a motion: memory, initial state, and limits of condition numbers that depend on the tolerances. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* Condition numbers below this are never too large. */
static const scalar LEAST_POOR = 10.0;

static const scalar LEAST_HOPELESS = 1e3, LEAST_TOO_POOR = 1e4; /* LEAST_TOO_POOR applies to constant steps */

static const scheme *method_of(const ordernm_problem *p)
{
    const scheme *const methods[] = {&ordernm_rk4, &ordernm_dop853, &ordernm_radau}; /* in the order of the methods' numbers */
    return methods[ordernm_kind(p)];
}

/* Number of long doubles: the workspace, and additional memory of NAME_precise.c. */
static long precise_numbers(const ordernm_system *s)
{
    const long values = 3L*s->nq + 3L*s->nu + s->np + s->ninputs + s->noutputs + s->nclosure + s->nloops;
    return s->workspace + values + LANES*(3L*s->nq + 3L*s->nu + s->np + s->ninputs + s->noutputs + 1);
}

/* Lays out the groups of directions, and sets the size of states with derivatives. */
static void lay_out_groups(ordernm_motion *m, memory *of, int at)
{
    const ordernm_problem *const p = m->problem;
    const ordernm_system *const s = m->system;
    m->ngroups = (p->ndirections + LANES - 1)/LANES;
    m->groups = (group *)ordernm_take(of, (m->ngroups + 1)*sizeof(group));
    m->size = m->values;
    for (int n = 0; n < m->ngroups; ++n) {
        const int left = p->ndirections - n*LANES;
        const int four = left <= LANES/2 && m->method->rows && s->state_rate_sensitivities[ORDERNM_FOUR];
        const int width = left == 1 ? 1 : four ? LANES/2 : LANES;
        const int index = left == 1 ? ORDERNM_ONE : four ? ORDERNM_FOUR : ORDERNM_EIGHT;
        group g = {width, index, n*LANES, left < LANES ? left : LANES, m->size, ordernm_numbers(of, s->np*width)};
        m->size += ordernm_whole_lines((long)(m->ny + m->nx)*width);
        if (at) m->groups[n] = g;
    }
    const group flow = {1, ORDERNM_ONE, 0, 1, m->size, ordernm_numbers(of, s->np)};
    if (at) m->groups[m->ngroups] = flow;
    m->lost = ordernm_numbers(of, (long)m->ngroups*LANES);
}

/* Memory for arguments and results of the system's functions at one state. */
static void lay_out_arguments(ordernm_motion *m, memory *of)
{
    const ordernm_system *const s = m->system;
    if (s->closing_step) m->precise_work = ordernm_take(of, precise_numbers(s)*sizeof(long double));
    scalar **of_q[] = {&m->q, &m->qdot, &m->newton, &m->closed}, **of_u[] = {&m->u, &m->udot};
    scalar **lanes_q[] = {&m->dq, &m->dqdot, &m->full_dq}, **lanes_u[] = {&m->du, &m->dudot, &m->full_du};
    const long wider = s->nq > s->nu ? s->nq : s->nu; /* qdot is also used for speeds */
    for (int i = 0; i < 4; ++i) *of_q[i] = ordernm_numbers(of, wider);
    for (int i = 0; i < 2; ++i) *of_u[i] = ordernm_numbers(of, s->nu);
    for (int i = 0; i < 3; ++i) *lanes_q[i] = ordernm_numbers(of, s->nq*LANES), *lanes_u[i] = ordernm_numbers(of, s->nu*LANES);
    m->outputs = ordernm_numbers(of, s->noutputs);
    m->doutputs = ordernm_numbers(of, s->noutputs*LANES);
    m->inputs = ordernm_numbers(of, s->ninputs);
    m->dinputs = ordernm_numbers(of, s->ninputs*LANES);
    m->input_rates = ordernm_numbers(of, s->ninputs);
    m->no_dp = ordernm_numbers(of, s->np);
    m->dt = ordernm_numbers(of, LANES);
}

static void lay_out_loops(ordernm_motion *m, memory *of)
{
    const ordernm_system *const s = m->system;
    const long loops = m->identity ? 0 : s->nloops;
    m->dependent = (int *)ordernm_take(of, (m->nd + 1)*sizeof(int));
    m->turned = (int *)ordernm_take(of, (s->nquaternions + 1)*sizeof(int));
    m->lengths = ordernm_numbers(of, s->nquaternions);
    for (int i = 0; i < 5; ++i) m->probe[i] = ordernm_numbers(of, m->nd ? m->values : 0);
    m->position = ordernm_numbers(of, s->nclosure);
    m->ranks = ordernm_numbers(of, MOST_STAGES*loops), m->ranks_between = ordernm_numbers(of, RANKS_BETWEEN*loops);
    m->condition = ordernm_numbers(of, s->nloops);
    m->flat = ordernm_numbers(of, 1 + 2L*s->nq);
    m->beside = ordernm_numbers(of, m->identity ? 0 : BESIDE*ordernm_event_size(m->problem));
}

static void lay_out_switches(ordernm_motion *m, memory *of, int at)
{
    const ordernm_system *const s = m->system;
    const int switching = s->switches != 0;
    const long lanes = switching ? (long)m->ngroups*LANES : 0;
    m->held = (int *)ordernm_take(of, (s->nswitches + 1)*sizeof(int));
    if (at) ordernm_hold_switches(m);
    for (int k = 0; k < s->nswitches; ++k) m->npoints += s->switch_kind[k] == ORDERNM_POINT && ordernm_matters(m, k);
    scalar **of_switches[] = {&m->modes, &m->switches, &m->crossed, &m->changed, &m->let_go, &m->speeds, &m->modes_before,
        &m->switches_kept, &m->passing_speed};
    for (int i = 0; i < 9; ++i) *of_switches[i] = ordernm_numbers(of, s->nswitches);
    m->switch_errors = ordernm_numbers(of, 2L*s->nswitches);
    m->together = (int *)ordernm_take(of, (s->nswitches + 1)*sizeof(int));
    m->resting = (int *)ordernm_take(of, (s->nswitches + 1)*sizeof(int));
    m->bent = (int *)ordernm_take(of, (s->nswitches + 1)*sizeof(int));
    m->z_before = ordernm_numbers(of, switching ? m->size : 0), m->z_after = ordernm_numbers(of, switching ? m->size : 0);
    const long beside = m->npoints ? m->size : 0;
    m->singular = ordernm_numbers(of, 5L*s->nswitches);
    for (int i = 0; i < ORDERNM_SIDES; ++i) m->sides[i] = ordernm_numbers(of, beside);
    m->at_point = ordernm_numbers(of, beside);
    m->moved_p = ordernm_numbers(of, m->npoints ? s->np : 0);
    m->dswitches = ordernm_numbers(of, (long)s->nswitches*LANES);
    scalar **of_lanes[] = {&m->switch_along, &m->switch_time, &m->passing_time};
    for (int i = 0; i < 3; ++i) *of_lanes[i] = ordernm_numbers(of, lanes);
}

static void lay_out_events(ordernm_motion *m, memory *of)
{
    const ordernm_problem *const p = m->problem;
    const int most_watched = p->nevents + m->system->nswitches;
    m->nwatched = p->nevents + m->nheld;
    scalar **of_events[] = {&m->crossing, &m->after, &m->within, &m->part, &m->happened, &m->paces, &m->at_first};
    for (int i = 0; i < 7; ++i) *of_events[i] = ordernm_numbers(of, most_watched);
    m->samples = ordernm_numbers(of, (long)EVENT_SAMPLES*most_watched);
}

/* Lays out the memory of a motion; `at` is 0 if only sizes are requested. The workspace of the system's functions comes last. It is much
 * larger than everything else and not initialised with `zeros`, which would fill the caches. */
static size_t lay_out(const ordernm_problem *p, void *at, size_t *zeros)
{
    memory of = {(char *)at, 0};
    const ordernm_system *s = p->system;
    ordernm_motion none, *m = (ordernm_motion *)ordernm_take(&of, sizeof *m);
    if (!at) m = &none;
    memset(m, 0, sizeof *m);
    m->problem = p;
    m->p = p->p;
    m->system = s;
    m->method = method_of(p);
    m->adaptive = p->method != ORDERNM_RK4 && !p->fixed;
    m->stable = INFINITY;
    m->flow_at = NAN;
    m->singular_at = NAN;
    m->ny = s->nfree_q + s->nfree_u;
    m->nx = p->nintegrals;
    m->nd = s->nq - s->nfree_q;
    m->identity = !s->closing_step;
    m->values = ordernm_whole_lines(m->ny + m->nx + m->nd);
    m->head = ordernm_head_size(p);
    lay_out_groups(m, &of, at != 0);
    const long without = m->size;
    if (ordernm_may_be_steep(m)) m->size += ordernm_whole_lines(m->ny + m->nx); /* memory for derivatives along the motion itself */
    for (int i = 0; i < m->method->all; ++i) m->rate[i] = ordernm_numbers(&of, m->size);
    scalar **states[] = {&m->z, &m->next, &m->trial, &m->zeros, m->error, m->error + 1, &m->at_pose};
    for (size_t i = 0; i < sizeof states/sizeof *states; ++i) *states[i] = ordernm_numbers(&of, m->size);
    m->stages = ordernm_numbers(&of, ordernm_step_size(p));
    m->fast = ordernm_numbers(&of, m->ny);
    scalar **rows[] = {&m->row, &m->known_row};
    for (int i = 0; i < 2; ++i) *rows[i] = ordernm_numbers(&of, ordernm_event_size(p));
    lay_out_arguments(m, &of);
    lay_out_loops(m, &of);
    lay_out_switches(m, &of, at != 0);
    lay_out_events(m, &of);
    if (m->method == &ordernm_radau) {
        void *own = ordernm_take(&of, ordernm_radau_layout(m, 0));
        if (own) ordernm_radau_layout(m, own);
    }
    m->size = without;
    *zeros = of.used;
    for (int i = 0; i <= HALVES; ++i) m->halves[i] = ordernm_numbers(&of, m->values);
    m->work = ordernm_numbers(&of, s->workspace);
    return of.used;
}

long ordernm_room(const ordernm_problem *problem)
{
    size_t zeros;
    return (long)(lay_out(problem, 0, &zeros)/sizeof(scalar)) + 8;
}

ordernm_motion *ordernm_begin(const ordernm_problem *p, scalar *room)
{
    void *const line = ordernm_line(room);
    size_t zeros;
    lay_out(p, 0, &zeros);
    memset(line, 0, zeros);
    lay_out(p, line, &zeros);
    ordernm_motion *const m = (ordernm_motion *)line;
    const ordernm_system *const s = p->system;
    for (int i = 0, free = 0, n = 0; i < s->nq; ++i) {
        if (free < s->nfree_q && s->free_q[free] == i) ++free;
        else m->dependent[n++] = i;
    }
    for (int i = 0; i < m->nd; ++i)
        for (int k = 0; k < s->nquaternions; ++k) m->turned[k] |= m->dependent[i] == s->quaternion[k];
    for (int i = 0; i < s->nfree_q; ++i) m->z[i] = p->q[s->free_q[i]];
    for (int i = 0; i < s->nfree_u; ++i) m->z[s->nfree_q + i] = p->u[s->free_u[i]];
    for (int i = 0; i < m->nd; ++i) m->z[m->ny + m->nx + i] = p->q[m->dependent[i]];
    for (int n = 0; n < m->ngroups; ++n) {
        const group *const g = m->groups + n;
        scalar *const S = m->z + g->at;
        for (int l = 0; l < g->used; ++l) {
            const long k = g->first + l;
            for (int i = 0; p->dq && i < s->nfree_q; ++i) S[i*g->width + l] = p->dq[k*s->nq + s->free_q[i]];
            for (int i = 0; p->du && i < s->nfree_u; ++i)
                S[(s->nfree_q + i)*g->width + l] = p->du[k*s->nu + s->free_u[i]];
            for (int i = 0; p->dp && i < s->np; ++i) g->dp[i*g->width + l] = p->dp[k*s->np + i];
            if (ordernm_finite_along(S, s->nfree_q + s->nfree_u, g->width, l)) continue;
            m->lost[n*LANES + l] = NAN; /* the direction lost its derivatives in a previous motion */
            for (int i = 0; i < s->nfree_q + s->nfree_u; ++i) S[i*g->width + l] = 0.0;
        }
    }
    m->t = p->start;
    /* rounding errors of closure conditions change dependents in proportion to the condition number, and rates in proportion to its square */
    const scalar rounding = fmax(1.0, s->nloops);
    m->poor = m->poor_rates = fmax(sqrt(0.01*p->rtol/(2.2e-16*rounding)), LEAST_POOR);
    /* in long double, errors of rates grow with the cube of the condition number, because coordinates are rounded to double; above
     * 0.03/rtol, branches are too close to each other for predictions to distinguish them */
    const scalar by_rounding = fmax(m->poor, cbrt(0.01*p->rtol/(5.4e-20*rounding)));
    m->too_poor = m->adaptive ? fmax(fmin(by_rounding, 0.03/p->rtol), LEAST_POOR) : fmax(by_rounding, LEAST_TOO_POOR);
    /* long double does not help here: constants are rotated in double precision, so equal lengths differ by rounding */
    m->telling = fmax(cbrt(0.01*p->rtol/(2.2e-16*rounding)), LEAST_POOR);
    /* rounding errors of speeds grow with the condition number, in long double with its square */
    m->hopeless = fmax(fmin(0.1*p->rtol/2.2e-16, sqrt(0.1*p->rtol/(5.4e-20*rounding))), LEAST_HOPELESS);
    m->pose = m->refused_pose = m->root_end = -INFINITY;
    m->mark = p->start;
    m->looked_at = p->looked_at;
    return m;
}

void ordernm_state(const ordernm_motion *m, scalar *q, scalar *u)
{
    const ordernm_system *s = m->system;
    for (int i = 0; i < s->nfree_q; ++i) q[s->free_q[i]] = m->z[i];
    for (int i = 0; i < m->nd; ++i) q[m->dependent[i]] = m->z[m->ny + m->nx + i];
    for (int i = 0; i < s->nu; ++i) u[i] = 0.0;
    for (int i = 0; i < s->nfree_u; ++i) u[s->free_u[i]] = m->z[s->nfree_q + i];
}
