/* The state of an instance: closing loops, and values of all variables. */
#include "unit.h"

#include <math.h>
#include <string.h>

/* Limits of a step in which Newton's method follows a mechanism: the largest change of independent coordinates and prescribed inputs (rad
 * or m) and of parameters (relative); the largest change of dependent coordinates; the largest number of steps, and of halvings of a
 * step. */
static const scalar AT_ONCE = 0.1, FAR = 0.5;
enum { MOST_STEPS = 1000, MOST_HALVES = 12 };

static const char OPEN[] = "the loops cannot be closed: Newton's method does not converge. The mechanism may be at the end of its reach, or "
                           "at a configuration where its dependent coordinates are not determined";

/* Logs why a function of the system failed. In Continuous-Time Mode the importer may try a state nearer to the last one. */
int unit_failed(unit *x, int status)
{
    const int found = unit_trial(x);
    if (status < 0) return unit_say(x, found, "at t = %.9g s %s", *x->t, OPEN);
    int known = 0;
    while (x->model->singular[known]) ++known;
    return unit_say(x, found, "at t = %.9g s %s is singular: a joint without inertia, a loop that has lost rank, or a force without "
                    "direction", *x->t, status >= 1 && status <= known ? x->model->singular[status - 1] : "the model");
}

/* Stores in x->way the arguments at a fraction of the way from the last closed state to the current one. */
static void take_way(unit *x, scalar part)
{
    const ordernm_system *const s = x->system;
    const scalar *const known = x->known;
    scalar *way = x->way;
    const scalar *wanted[] = {x->t, 0, x->p, x->inputs};
    const int sizes[] = {1, x->nfq, x->np, x->ni};
    for (int n = 0, at = 0; n < 4; at += sizes[n++])
        for (int i = 0; i < sizes[n]; ++i) {
            const scalar to = n == 1 ? x->q[s->free_q[i]] : wanted[n][i];
            way[at + i] = part < 1.0 ? known[at + i] + part*(to - known[at + i]) : to;
        }
}

/* Arguments of functions at x->way; m->z receives the state with the dependent coordinates x->near. */
static void arguments(unit *x, ordernm_call *c)
{
    const ordernm_system *const s = x->system;
    ordernm_motion *const m = x->motion;
    for (int i = 0; i < x->nfq; ++i) m->z[i] = x->way[1 + i];
    for (int i = 0; i < x->nfu; ++i) m->z[x->nfq + i] = x->u[s->free_u[i]];
    for (int i = 0; i < m->nd; ++i) m->z[m->ny + m->nx + i] = x->near[m->dependent[i]];
    memcpy(m->modes, x->modes, x->ns*sizeof(scalar));
    m->p = x->way + 1 + x->nfq;
    ordernm_arguments(m, x->way[0], m->z, c);
    c->inputs = x->way + 1 + x->nfq + x->np;
}

/* Closes the loops at a fraction of the way. Fails if the state is far from the last one, because the step may have left the branch. */
static int close_at(unit *x, scalar part, ordernm_call *c)
{
    const ordernm_motion *const m = x->motion;
    take_way(x, part);
    arguments(x, c);
    const int status = ordernm_close_loops(x->motion, c);
    if (status || m->identity) return status;
    for (int i = 0; i < m->nd; ++i)
        if (fabs(m->q[m->dependent[i]] - x->near[m->dependent[i]]) > FAR) return -1;
    memcpy(x->near, m->q, x->nq*sizeof(scalar));
    return 0;
}

static int number_of_steps(const unit *x)
{
    const ordernm_system *const s = x->system;
    const int first = 1 + x->nfq + x->np;
    scalar longest = 0.0;
    if (x->model->moved && *x->mode <= INITIALIZING && x->way[0] != x->known[0]) return MOST_STEPS; /* a start later than at t = 0 */
    for (int i = 0; i < s->nmoving; ++i) longest = fmax(longest, fabs(x->way[first + s->moving[i]] - x->known[first + s->moving[i]]));
    for (int i = 1; i < first; ++i) {
        const scalar scale = i <= x->nfq ? 1.0 : fabs(x->known[i]) + AT_ONCE;
        longest = fmax(longest, fabs(x->way[i] - x->known[i])/scale);
    }
    for (int i = 0; x->model->moved && i < x->nq; ++i) longest = fmax(longest, fabs((x->way[0] - x->known[0])*x->qdot[i]));
    return (int)fmin(1.0 + longest/AT_ONCE, MOST_STEPS);
}

/* Closes the loops of the current state. The mechanism is followed from the last closed state, so that it stays on its branch. */
static int close_loops(unit *x, ordernm_call *c)
{
    memcpy(x->near, x->q, x->nq*sizeof(scalar));
    if (x->motion->identity) return close_at(x, 1.0, c);
    take_way(x, 1.0);
    scalar done = 0.0, step = 1.0/number_of_steps(x);
    const scalar least = step/(1 << MOST_HALVES);
    while (done < 1.0) {
        const scalar next = done + step < 1.0 - 1e-9 ? done + step : 1.0;
        const int status = close_at(x, next, c);
        if (!status) done = next;
        else if ((step *= 0.5) < least) return status;
    }
    return 0;
}

/* Arguments of functions at the current state, after unit_update. */
void unit_arguments(unit *x, ordernm_call *c)
{
    memcpy(x->near, x->q, x->nq*sizeof(scalar));
    take_way(x, 1.0);
    arguments(x, c);
    c->dq = x->dq, c->du = x->du, c->dp = x->dp, c->dinputs = x->di, c->dt = x->dt;
    c->qdot = x->qdot, c->udot = x->udot, c->outputs = x->outputs, c->switches = x->switches;
    c->full_u = x->motion->qdot;
}

/* An initial value after its expression has changed from `before` to `now`. If the known value differs from `before`, because the initial
 * values of the model file do not close the loops, it changes by the same difference as the expression. */
static scalar moved(scalar known, scalar before, scalar now) { return known == before ? now : known + (now - before); }

/* Until initialisation ends, initial values that the importer has not set follow from the parameters. */
static int take_initial(unit *x)
{
    const ordernm_system *const s = x->system;
    if (!x->model->initial || *x->mode > INITIALIZING) return 0;
    int status = x->model->initial(x->model->p, x->dfull_q, x->dudot, x->motion->work);
    if (!status) status = x->model->initial(x->p, x->near, x->dfull_u, x->motion->work);
    if (status) return status;
    for (int i = 0; i < x->nfq; ++i) {
        const int k = s->free_q[i];
        if (x->given[i] == 0.0) x->q[k] = moved(x->model->q[k], x->dfull_q[k], x->near[k]);
    }
    for (int i = 0; i < x->nfu; ++i) {
        const int k = s->free_u[i];
        if (x->given[x->nfq + i] == 0.0) x->u[k] = moved(x->model->u[k], x->dudot[k], x->dfull_u[k]);
    }
    return 0;
}

/* The state has changed. */
void unit_change(unit *x)
{
    x->computed = 0;
    *x->closed = 0.0;
}

/* The integrator has found the current state, with closed loops. */
void unit_took_step(unit *x)
{
    take_way(x, 1.0);
    memcpy(x->known, x->way, (1 + x->nfq + x->np + x->ni)*sizeof(scalar));
    unit_change(x);
}

/* Computes all variables at the current state. */
int unit_update(unit *x)
{
    if (x->computed) return UNIT_OK;
    const ordernm_system *const s = x->system;
    ordernm_call c;
    int status = take_initial(x);
    if (status) return unit_failed(x, status);
    if (*x->closed != 0.0) unit_arguments(x, &c); /* closing the loops again would change the last bits */
    else if ((status = close_loops(x, &c))) return unit_failed(x, status);
    *x->closed = 1.0;
    memcpy(x->known, x->way, (1 + x->nfq + x->np + x->ni)*sizeof(scalar));
    for (int i = 0; i < x->motion->nd; ++i) x->q[x->motion->dependent[i]] = x->motion->q[x->motion->dependent[i]];
    if (s->completion) {
        c.full_u = x->dfull_u;
        if ((status = s->completion(&c))) return unit_failed(x, status);
        scalar *const u = x->dfull_u;
        for (int i = 0; i < x->nfu; ++i) u[s->free_u[i]] = x->u[s->free_u[i]];
        memcpy(x->u, u, x->nu*sizeof(scalar));
    }
    c.qdot = x->qdot, c.udot = x->udot, c.outputs = x->outputs, c.switches = x->switches;
    if ((status = s->state_rates(&c))) return unit_failed(x, status);
    if (s->outputs && (status = s->outputs(&c))) return unit_failed(x, status);
    if (s->switches && (status = s->switches(&c))) return unit_failed(x, status);
    x->computed = 1;
    return UNIT_OK;
}

/* Gives an angle the mode of the other side if it is at half a turn, up to rounding, and moves beyond half a turn. Returns the status of a
 * function. */
static int pass_half_turns(unit *x, scalar rounding)
{
    ordernm_motion *const m = x->motion;
    for (int i = 0; i < m->nheld; ++i) {
        const int k = m->held[i];
        scalar speed;
        if (x->system->switch_kind[k] != ORDERNM_TURN) continue;
        int status = ordernm_switching(m, *x->t, m->z);
        if (!status) status = ordernm_rates_of(m, *x->t, m->z, m->trial, 0, 0, RATES);
        if (!status) status = ordernm_switch_speed(m, *x->t, m->z, m->trial, k, &speed);
        if (status) return status;
        const scalar angle = m->switches[k];
        if (HALF_A_TURN - fabs(angle) <= rounding*(1.0 + fabs(speed)) && angle*speed > 0.0) m->modes[k] = ordernm_other_mode(m, k);
    }
    return 0;
}

/* Chooses the modes of the current state; after unit_update. Events within `rounding`, s, have occurred. Returns 0, the status of a
 * function, or SLIDES. */
int unit_settle(unit *x, scalar rounding)
{
    ordernm_motion *const m = x->motion;
    ordernm_call c;
    if (!m->nheld) return 0;
    unit_arguments(x, &c);
    ordernm_find_segment(m, *x->t, rounding);
    int status = ordernm_choose_modes(m, *x->t, m->z);
    if (!status) status = pass_half_turns(x, rounding);
    if (!status) memcpy(x->modes, m->modes, x->ns*sizeof(scalar));
    unit_change(x);
    return status;
}
