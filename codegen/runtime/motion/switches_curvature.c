/* Passing switches with tangents, and the adjoint of switches with its tangents.
 *
 * A switch g(y, t) = 0 is passed at the time T(y) after the time of a state y, which stands for the state z, the parameters and the
 * inputs. The motion with the rates f+ that goes through the same point is the one from
 *
 *     z + T (f- - f+) + T^2/2 (f-' + f+') - T^2 f+_y F-,  f' = f_y F,
 *
 * up to T^3; F- and F+ are the rates f-, f+ with those of the inputs and of time. With the adjoint lambda after the switch, weights of
 * integrals included, a = lambda . f, D = a-_y - a+_y, and g' = g_y F-, all at T = 0,
 *
 *     T_y = -g_y/g',   dT_y = -(g_yy v + T_v g'_y + T_y (g'_y v) + T_y T_v g'_y F-)/g',
 *     lambda- = lambda + (a- - a+) T_y,
 *     dlambda- = dlambda + dlambda.(f- - f+) T_y + (a- - a+) dT_y + T_y (D v) + T_v D + T_v T_y (D F- + a+_y (F+ - F-)),
 *
 * for changes along v; the gradients with respect to parameters and inputs get the same terms. At a kink f- = f+, but D is not zero. */
#include "curvature.h"

#include <math.h>
#include <string.h>

/* Gradients, or derivatives of rates, count as equal if their relative difference is below SAME. A switching function counts as zero at the
 * start if it is below ROUNDED, or if it would be zero within the fraction AT_ZERO of the motion's duration. */
static const scalar SAME = 1e-9, AT_ZERO = 1e-13, ROUNDED = 1e-12;

/* Number of entries in a gradient with respect to y and time. */
static long size_of(const ordernm_curvature *c)
{
    const ordernm_system *const s = c->motion->system;
    return c->n + s->np + s->ninputs + 1L;
}

static int closed(ordernm_curvature *c, scalar t, const scalar *z, ordernm_call *call)
{
    ordernm_arguments(c->motion, t, z, call);
    return ordernm_close_loops(c->motion, call);
}

/* Calls a function for gradients, and adds its results to one. */
static int add_gradient(ordernm_curvature *c, ordernm_function *f, ordernm_call call, scalar *to)
{
    const gradient *const v = &c->values;
    ordernm_clear_gradient(c, v, 1);
    call.qdot = c->motion->qdot, call.udot = c->motion->udot, call.outputs = c->motion->outputs, call.switches = c->motion->switches;
    call.dq = v->q, call.du = v->u, call.dp = v->p, call.dinputs = v->inputs, call.dt = v->t;
    const int status = f(&call);
    if (!status) to[size_of(c) - 1] += ordernm_add_row(c, v, 1, 0, to);
    return status;
}

/* The gradient of weighted rates of the state, and of weighted outputs unless `outputs` is 0. */
static int gradient_of_rates(ordernm_curvature *c, scalar t, const scalar *z, const scalar *weights, const scalar *outputs, scalar *to)
{
    const ordernm_system *const s = c->motion->system;
    ordernm_call call;
    memset(to, 0, size_of(c)*sizeof(scalar));
    int status = closed(c, t, z, &call);
    if (status) return status;
    memset(c->db, 0, s->nu*sizeof(scalar));
    for (int i = 0; i < s->nfree_u; ++i) c->db[s->free_u[i]] = weights[s->nfree_q + i];
    call.dudot = c->db;
    if ((status = add_gradient(c, s->sensitivities_transposed[ORDERNM_ONE], call, to))) return status;
    if (s->plain_rates) ordernm_add_to(to + s->nfree_q, 1.0, weights, s->nfree_q);
    else {
        memset(c->dqdot, 0, s->nq*sizeof(scalar));
        for (int i = 0; i < s->nfree_q; ++i) c->dqdot[s->free_q[i]] = weights[i];
        call.dqdot = c->dqdot;
        if ((status = add_gradient(c, s->coordinate_rate_sensitivities_transposed[ORDERNM_ONE], call, to))) return status;
    }
    if (!outputs || !ordernm_some(outputs, s->noutputs)) return 0;
    call.doutputs = (scalar *)outputs;
    return add_gradient(c, s->output_sensitivities_transposed[ORDERNM_ONE], call, to);
}

static int gradient_of_switch(ordernm_curvature *c, scalar t, const scalar *z, int k, scalar *to)
{
    ordernm_motion *const m = c->motion;
    ordernm_call call;
    memset(to, 0, size_of(c)*sizeof(scalar));
    int status = closed(c, t, z, &call);
    if (status) return status;
    memset(c->one, 0, m->system->nswitches*sizeof(scalar));
    c->one[k] = 1.0;
    call.dswitches = c->one;
    return add_gradient(c, m->system->switch_sensitivities_transposed[ORDERNM_ONE], call, to);
}

/* Changes of the gradient of a switching function, a row for each lane: along a group's directions or, with 0, along the motion with the
 * given rates. */
static int curvature_of_switch(ordernm_curvature *c, scalar t, const scalar *z, int k, const group *g, const scalar *rates, scalar *to)
{
    ordernm_motion *const m = c->motion;
    const gradient *const d = &c->along;
    const int width = g ? g->width : 1;
    ordernm_call call;
    const long size = size_of(c);
    memset(to, 0, size*width*sizeof(scalar));
    int status = g ? closed(c, t, z, &call) : ordernm_along_time(m, t, z, rates, &call);
    if (status) return status;
    if (g) ordernm_seeds(m, t, z, g, &call), call.dt = c->no_dt;
    memset(c->one, 0, m->system->nswitches*sizeof(scalar));
    c->one[k] = 1.0;
    ordernm_clear_gradient(c, d, width);
    call.switch_weights = c->one;
    call.dgq = d->q, call.dgu = d->u, call.dgp = d->p, call.dginputs = d->inputs, call.dgt = d->t;
    status = m->system->switch_hessian_products[g ? g->index : ORDERNM_ONE](&call);
    for (int l = 0; l < width && !status; ++l) to[l*size + size - 1] += ordernm_add_row(c, d, width, l, to + l*size);
    return status;
}

/* ---- Forwards. ---- */

static void refuse(ordernm_curvature *c, int reason, int k)
{
    c->found->refused = reason, c->found->refused_switch = k;
}

/* Computes, for switch k: the rates before it (c->before), these minus the rates after it (c->jump), the rate of its function, and the
 * derivatives of its time. Afterwards modes are those before the switch. */
static int examine(ordernm_curvature *c, scalar t, const scalar *z, const scalar *row, const scalar *first, int k, scalar *speed)
{
    ordernm_motion *const m = c->motion;
    const int n = m->ny + m->nx;
    int by, status;
    ordernm_modes_beside(m, row, first, k, 1);
    if ((status = ordernm_rates_of(m, t, z, c->jump, 0, 0, RATES | INTEGRALS))) return status;
    ordernm_modes_beside(m, row, first, k, 0);
    if ((status = ordernm_rates_of(m, t, z, c->before, 0, 0, RATES | INTEGRALS))) return status;
    const int jumps = ordernm_rates_jump(m, c->before, c->jump);
    for (int i = 0; i < n; ++i) c->jump[i] = jumps ? c->before[i] - c->jump[i] : 0.0;
    if ((status = ordernm_timing_switch(m, t, z, c->before, row + m->system->nswitches, k, speed, &by))) return status;
    if (by != k) refuse(c, ORDERNM_TIMED_BY_ANOTHER, k);
    if ((status = ordernm_switch_along(m, t, z, k))) return status;
    for (int i = 0; i < m->ngroups*LANES; ++i) m->passing_time[i] = -m->switch_along[i]/ *speed;
    return 0;
}

/* Passes one switch: S+ = S- + (f- - f+) T_v. */
static int pass(ordernm_curvature *c, scalar t, scalar *z, const scalar *row, const scalar *first, int k)
{
    ordernm_motion *const m = c->motion;
    scalar speed;
    const int status = examine(c, t, z, row, first, k, &speed);
    for (const group *g = m->groups; !status && g < m->groups + m->ngroups; ++g)
        for (int i = 0; i < m->ny; ++i)
            for (int l = 0; l < g->width; ++l) z[g->at + (long)i*g->width + l] += c->jump[i]*m->passing_time[(g - m->groups)*LANES + l];
    return status;
}

/* Finds a switch at which the motion begins, and at which derivatives of rates along the directions jump. */
int ordernm_look_at_begin(ordernm_curvature *c)
{
    ordernm_motion *const m = c->motion;
    scalar *const sides[] = {c->before, c->jump};
    for (int i = 0; i < m->nheld; ++i) {
        const int k = m->held[i];
        const scalar mode = m->modes[k];
        scalar speed;
        int status = ordernm_rates_of(m, m->t, m->z, c->before, 0, 0, RATES);
        if (!status) status = ordernm_switch_speed(m, m->t, m->z, c->before, k, &speed);
        if (status) return status;
        const scalar near = fmax(AT_ZERO*(m->problem->end - m->problem->start)*fabs(speed), ROUNDED);
        if (m->system->switch_kind[k] > ORDERNM_ROOT || fabs(m->switches[k]) > near) continue;
        for (int n = 0; n < 2 && !status; ++n) {
            m->modes[k] = 1 - 2*n;
            for (const group *g = m->groups; g < m->groups + m->ngroups && !status; ++g)
                status = ordernm_rates_of(m, m->t, m->z, sides[n], 1, g, RATES);
        }
        m->modes[k] = mode;
        if (status) return status;
        for (const group *g = m->groups; g < m->groups + m->ngroups; ++g)
            for (long j = g->at; j < g->at + (long)m->ny*g->width; ++j)
                if (fabs(sides[0][j] - sides[1][j]) > SAME*(fabs(sides[0][j]) + fabs(sides[1][j]))) refuse(c, ORDERNM_BEGINS_AT_A_SWITCH, k);
    }
    return 0;
}

static int is_passed(const ordernm_motion *m, const scalar *row, int k) { return row[m->system->nswitches + k] != 0.0; }

static int some_passed(const ordernm_motion *m, const scalar *row)
{
    int found = 0;
    for (int k = 0; k < m->system->nswitches; ++k) found |= is_passed(m, row, k);
    return found;
}

int ordernm_switches_along(ordernm_curvature *c, const scalar *row)
{
    ordernm_motion *const m = c->motion;
    const long record = ordernm_hessians_record(c);
    int status = 0;
    if (some_passed(m, row)) {
        scalar *const kept = c->found->passed + c->passed*(record + m->system->nswitches), *const first = kept + record;
        if (++c->passed > c->passed_all) c->passed_all = c->passed;
        memcpy(first, m->modes, m->system->nswitches*sizeof(scalar));
        status = ordernm_close_and_keep(c, m->t, m->z, kept);
        for (int k = 0; k < m->system->nswitches && !status; ++k)
            if (is_passed(m, row, k)) status = pass(c, m->t, m->z, row, first, k);
    }
    ordernm_take_modes(m, row);
    return status;
}

/* ---- Backwards. ---- */

static scalar product(const scalar *a, const scalar *b, long n)
{
    scalar sum = 0.0;
    for (long i = 0; i < n; ++i) sum += a[i]*b[i];
    return sum;
}

/* Change of a function with a given gradient along the motion: of the state with these rates, the inputs and time. */
static scalar along_motion(const ordernm_curvature *c, const scalar *of, const scalar *rates)
{
    const ordernm_system *const s = c->motion->system;
    const scalar *const inputs = of + c->n + s->np;
    return product(of, rates, c->n) + product(inputs, c->motion->input_rates, s->ninputs) + inputs[s->ninputs];
}

/* Change of a function with a given gradient along a direction at the state z; `inputs` are the derivatives of the inputs. */
static scalar along_lane(const ordernm_curvature *c, const scalar *of, const scalar *z, const scalar *inputs, const group *g, int l)
{
    const ordernm_system *const s = c->motion->system;
    scalar sum = 0.0;
    for (int i = 0; i < c->n; ++i) sum += of[i]*z[g->at + (long)i*g->width + l];
    for (int i = 0; i < s->np; ++i) sum += of[c->n + i]*g->dp[i*g->width + l];
    for (int i = 0; i < s->ninputs; ++i) sum += of[c->n + s->np + i]*inputs[i*g->width + l];
    return sum;
}

/* Compares a switch with the one that is passed next: at the same time, and with a jump of rates, both must have the same function up to a
 * factor. Otherwise another motion passes them in another order. */
static void compare_with_next(ordernm_curvature *c, scalar t, int k, const scalar *by, const scalar *rate, scalar speed)
{
    const long size = size_of(c);
    scalar *const next = c->next_switch, *const jumps = next + 2*size, *const time = jumps + 1;
    const int jump = ordernm_some(c->jump, c->motion->ny);
    const int at_once = fabs(*time - t) <= AT_THE_SAME_TIME*(c->problem.end - c->problem.start);
    for (long i = 0; i < 2*size; ++i) {
        const scalar here = (i < size ? by[i] : rate[i - size])/speed, there = next[i];
        if (at_once && (jump || *jumps != 0.0) && fabs(here - there) > SAME*(fabs(here) + fabs(there)) + ROUNDED)
            refuse(c, ORDERNM_AT_THE_SAME_TIME, k);
        next[i] = here;
    }
    *jumps = jump, *time = t;
}

/* The adjoint before switch k, at a state with tangents before it. */
static int pass_back(ordernm_curvature *c, scalar t, const scalar *z, const scalar *row, const scalar *first, int k)
{
    ordernm_motion *const m = c->motion;
    const ordernm_system *const s = m->system;
    const long size = size_of(c), n = c->n, inputs = n + s->np;
    scalar *const by = c->of_switch, *const rate = by + size, *const a = rate + size, *const D = a + size, *const change = D + size;
    scalar *const rows = change + LANES*size, *const of_rates = rows + (1L + c->problem.ndirections)*(size - 1);
    scalar speed, *const bend = D; /* before D is known */
    int status = examine(c, t, z, row, first, k, &speed);
    if (status || (status = gradient_of_switch(c, t, z, k, by))) return status;
    if ((status = curvature_of_switch(c, t, z, k, 0, c->before, rate))) return status;
    if ((status = gradient_of_rates(c, t, z, by, 0, bend))) return status;
    ordernm_add_to(rate, 1.0, bend, size); /* g'_y */
    compare_with_next(c, t, k, by, rate, speed);
    if ((status = gradient_of_rates(c, t, z, c->lambda, c->found->weights, D))) return status;
    ordernm_modes_beside(m, row, first, k, 1);
    if ((status = gradient_of_rates(c, t, z, c->lambda, c->found->weights, a))) return status;
    ordernm_modes_beside(m, row, first, k, 0);
    ordernm_add_to(D, -1.0, a, size);
    scalar jump = product(c->lambda, c->jump, n);
    for (int i = 0; i < m->nx; ++i) jump += c->found->weights[m->problem->integrals[i]]*c->jump[m->ny + i];
    ordernm_input_rates(m, t, 1, m->input_rates);
    const scalar twice = along_motion(c, D, c->before) - product(a, c->jump, n);
    scalar faster = along_motion(c, rate, c->before);
    ordernm_input_rates(m, t, 2, m->input_rates);
    faster += product(by + inputs, m->input_rates, s->ninputs);
    for (long i = 0; i < size - 1; ++i) rows[i] = -jump*by[i]/speed;
    memset(of_rates, 0, s->ninputs*sizeof(scalar));
    for (const group *g = m->groups; g < m->groups + m->ngroups; ++g) {
        if ((status = curvature_of_switch(c, t, z, k, g, 0, change))) return status;
        for (int l = 0; l < g->used; ++l) {
            const scalar T_v = m->passing_time[(g - m->groups)*LANES + l];
            scalar of_lambda = 0.0;
            for (int i = 0; i < n; ++i) of_lambda += c->lambda[g->at + (long)i*g->width + l]*c->jump[i];
            const scalar *const dinputs = ordernm_input_directions(m, t, g, 0);
            const scalar D_v = along_lane(c, D, z, dinputs, g, l);
            scalar rate_v = along_lane(c, rate, z, dinputs, g, l);
            const scalar *const drates = ordernm_input_directions(m, t, g, 1);
            for (int i = 0; i < s->ninputs; ++i) rate_v += by[inputs + i]*drates[i*g->width + l];
            scalar *const to = rows + (1L + g->first + l)*(size - 1), *const later = of_rates + (1L + g->first + l)*s->ninputs;
            for (long i = 0; i < size - 1; ++i) {
                const scalar T_y = -by[i]/speed;
                const scalar dT_y = -(change[l*size + i] + T_v*rate[i] + T_y*(rate_v + T_v*faster))/speed;
                to[i] = of_lambda*T_y + jump*dT_y + T_y*(D_v + T_v*twice) + T_v*D[i];
            }
            for (int i = 0; i < s->ninputs; ++i) later[i] = -jump*T_v*by[inputs + i]/speed;
        }
    }
    ordernm_add_source(c, t, 1.0, rows, c->lambda);
    for (long d = 0; s->ninputs && d <= c->problem.ndirections; ++d) ordernm_add_inputs(c, t, 1, of_rates + d*s->ninputs, 1, d, 1, 1.0);
    return 0;
}

int ordernm_switches_along_back(ordernm_curvature *c, const scalar *row)
{
    ordernm_motion *const m = c->motion;
    const long record = ordernm_hessians_record(c);
    int status = 0;
    if (!some_passed(m, row)) return 0;
    const scalar *const kept = c->found->passed + --c->passed_left*(record + m->system->nswitches), *const first = kept + record;
    scalar *const z = m->next;
    for (int k = m->system->nswitches - 1; k >= 0 && !status; --k) {
        if (!is_passed(m, row, k)) continue;
        ordernm_take_record(c, kept, z);
        for (int i = 0; i < k && !status; ++i)
            if (is_passed(m, row, i)) status = pass(c, m->t, z, row, first, i);
        if (!status) status = pass_back(c, m->t, z, row, first, k);
    }
    return status;
}
