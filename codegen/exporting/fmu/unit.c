/* Instances: memory, variables by value reference, time, states and events, and steps of Co-Simulation. */
#include "unit.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Time limit of a run of the integrator, s; 0 for none, so that a step of Co-Simulation runs to its end. */
static const scalar AT_ANY_TIME = 0.0;
enum { LONGEST_TEXT = 1024, MOST_STEPS_OF_A_STEP = 1000000 };

/* Largest relative difference between the importer's communication point and the instance's time. */
static const scalar SAME_TIME = 1e-9;

/* SAME_MOMENT: relative difference of times within which an event known in advance counts as reached. AT_ZERO: time, relative to the
 * duration of a motion, within which a motion that starts at a switch counts as being at the switch (switches.c). */
static const scalar SAME_MOMENT = 1e-12, AT_ZERO = 1e-13;

/* Step, relative to the time, below which rounding errors of the time stop the integrator. */
static const scalar SMALLEST_STEP = 1e-12;

/* Smallest relative tolerance of the integrator; smaller errors would be below rounding. */
static const scalar SMALLEST_TOLERANCE = 1e-14;

/* Logs a message, and returns its status. */
int unit_say(unit *x, int status, const char *format, ...)
{
    char text[LONGEST_TEXT];
    va_list values;
    va_start(values, format);
    vsnprintf(text, sizeof text, format, values);
    va_end(values);
    if (x->log) x->log(x, status, text);
    return status;
}

/* Refuses null pointers where n entries are expected; the pointer `other`, to an array of the same call, is checked too. */
int unit_has(unit *x, size_t n, const void *one, const void *other)
{
    return !n || (one && other) ? UNIT_OK : unit_say(x, UNIT_ERROR, "an array of %zu entries is a null pointer", n);
}

/* ---- Memory. ---- */

/* Divides memory among the arrays of an instance; `at` is 0 if only the size is requested. Returns the number of doubles. */
static long lay_out(unit *x, scalar *at)
{
    const long nq = x->nq, nu = x->nu, np = x->np, ni = x->ni, ny = x->ny, ns = x->ns, ways = 1 + x->nfq + np + ni;
    struct { scalar **to; long n; } parts[] = {
        {&x->mode, 1}, {&x->t, 1}, {&x->stop, 1}, {&x->step, 1}, {&x->rtol, 1}, {&x->closed, 1}, {&x->given, x->nfq + x->nfu}, {&x->q, nq}, {&x->u, nu}, {&x->p, np},
        {&x->inputs, ni}, {&x->modes, ns}, {&x->known, ways}, {0, 0}, /* the saved part ends here */
        {&x->qdot, nq}, {&x->udot, nu}, {&x->outputs, ny}, {&x->switches, ns}, {&x->way, ways}, {&x->near, nq},
        {&x->dq, nq}, {&x->du, nu}, {&x->dp, np}, {&x->di, ni}, {&x->dt, 1}, {&x->dqdot, nq}, {&x->dudot, nu}, {&x->doutputs, ny},
        {&x->dfull_q, nq}, {&x->dfull_u, nu}, {&x->dswitches, ns}, {x->gradient, nq}, {x->gradient + 1, nu}, {x->gradient + 2, np},
        {x->gradient + 3, ni}, {x->gradient + 4, 1}, {&x->atol, x->nfq + x->nfu + nq}, {&x->points, 3*ni},
        {&x->row, 2*(1 + nq + nu + ny)},
    };
    long used = 0;
    for (size_t i = 0; i < sizeof parts/sizeof *parts; ++i) {
        if (!parts[i].to) x->saved = used;
        else if (at) *parts[i].to = at + used;
        used += parts[i].n;
    }
    return used + 8;
}

unit *unit_new(int integrates, const char *instance, void (*log)(unit *x, int status, const char *text), void *environment, void *callback)
{
    unit *const x = calloc(1, sizeof *x);
    if (!x) return 0;
    x->model = &ordernm_unit_model;
    const ordernm_system *const s = x->system = x->model->system;
    x->integrates = integrates;
    x->log = log, x->environment = environment, x->callback = callback;
    x->nq = s->nq, x->nu = s->nu, x->np = s->np, x->ni = s->ninputs, x->ny = s->noutputs, x->ns = s->nswitches;
    x->nfq = s->nfree_q, x->nfu = s->nfree_u;
    if (!s->closing_step) x->nfq = s->nq, x->nfu = s->nu;
    x->problem.system = s;
    x->problem.method = x->model->method;
    x->problem.rtol = x->model->rtol;
    x->problem.ntimes = 1;
    x->instance = calloc(strlen(instance ? instance : "") + 1, 1);
    x->memory[0] = calloc((size_t)lay_out(x, 0), sizeof(scalar));
    x->memory[1] = calloc((size_t)ordernm_room(&x->problem), sizeof(scalar));
    if (!x->instance || !x->memory[0] || !x->memory[1]) {
        unit_say(x, UNIT_ERROR, "there is not enough memory");
        unit_free(x);
        return 0;
    }
    strcpy(x->instance, instance ? instance : "");
    lay_out(x, x->memory[0]);
    x->problem.q = x->q, x->problem.u = x->u, x->problem.p = x->p, x->problem.atol = x->atol;
    x->problem.times = &x->problem.end;
    x->problem.most_steps = MOST_STEPS_OF_A_STEP;
    x->problem.inputs.count = s->nmoving ? 3 : 1;
    x->problem.inputs.degree = s->nmoving ? 2 : 0;
    x->problem.inputs.values = s->nmoving ? x->points : x->inputs;
    x->problem.inputs.knots = s->nmoving ? x->knots : 0;
    unit_reset(x);
    return x;
}

void unit_free(unit *x)
{
    if (!x) return;
    free(x->instance);
    free(x->memory[0]);
    free(x->memory[1]);
    free(x);
}

/* Duration of the polynomials that continue inputs of prescribed motion: at least h, and not so short that differences of control points
 * cancel. */
static scalar length_of_inputs(const unit *x, scalar h)
{
    const ordernm_system *const s = x->system;
    const int n = ordernm_signals(s);
    scalar length = 1.0;
    for (int k = 0; k < s->nmoving; ++k) {
        const scalar size = 1.0 + fabs(x->inputs[s->moving[k]]);
        const scalar rate = fabs(x->inputs[n + 2*k]), acceleration = fabs(x->inputs[n + 2*k + 1]);
        length = fmin(length, size/(rate + sqrt(size*acceleration) + size));
    }
    return fmax(h, length);
}

/* Polynomials that continue inputs of prescribed motion by their rates and accelerations from t to t + h; other inputs are constant. */
static void continue_inputs(unit *x, scalar t, scalar h)
{
    const ordernm_system *const s = x->system;
    const int n = ordernm_signals(s);
    if (!s->nmoving) return;
    const scalar length = length_of_inputs(x, h);
    for (int i = 0; i < 6; ++i) x->knots[i] = i < 3 ? t : t + length;
    for (int i = 0; i < n; ++i)
        for (int k = 0; k < 3; ++k) x->points[k*n + i] = x->inputs[i];
    for (int k = 0; k < s->nmoving; ++k) {
        const int i = s->moving[k];
        const scalar rate = x->inputs[n + 2*k], acceleration = x->inputs[n + 2*k + 1];
        x->points[n + i] += 0.5*length*rate;
        x->points[2*n + i] += length*rate + 0.5*length*length*acceleration;
    }
}

/* Inputs of prescribed motion, and their rates, on their polynomials after a time h. */
static void move_inputs(unit *x, scalar h)
{
    const ordernm_system *const s = x->system;
    const int n = ordernm_signals(s);
    for (int k = 0; k < s->nmoving; ++k) {
        scalar *const rates = x->inputs + n + 2*k;
        x->inputs[s->moving[k]] += h*rates[0] + 0.5*h*h*rates[1];
        rates[0] += h*rates[1];
    }
}

/* The integrator's memory for a motion from t to t + h. */
static void begin(unit *x, scalar t, scalar h)
{
    continue_inputs(x, t, h);
    x->problem.start = t, x->problem.end = t + h, x->problem.step = *x->step, x->problem.rtol = *x->rtol;
    for (int i = 0; i < x->nfq + x->nfu + x->nq; ++i) x->atol[i] = *x->rtol;
    memset(&x->results, 0, sizeof x->results);
    x->results.rows = x->row, x->results.capacity = 2;
    x->results.as_is = 1; /* this code has no functions in long double */
    x->motion = ordernm_begin(&x->problem, x->memory[1]);
    x->motion->results = &x->results;
    ordernm_find_segment(x->motion, t, h);
}

void unit_reset(unit *x)
{
    memset(x->mode, 0, x->saved*sizeof(scalar));
    *x->rtol = x->model->rtol, *x->stop = INFINITY;
    memcpy(x->q, x->model->q, x->nq*sizeof(scalar));
    memcpy(x->u, x->model->u, x->nu*sizeof(scalar));
    if (x->np) memcpy(x->p, x->model->p, x->np*sizeof(scalar));
    for (int i = 0; i < x->nfq; ++i) x->known[1 + i] = x->q[x->system->free_q[i]];
    if (x->np) memcpy(x->known + 1 + x->nfq, x->p, x->np*sizeof(scalar));
    x->computed = 0;
    begin(x, 0.0, 1.0);
}

/* ---- Variables. ---- */

/* Returns the kind of a variable, and stores its index among the variables of this kind. */
int unit_of(const unit *x, unsigned variable, int *index)
{
    const int sizes[] = {1, x->nq, x->nu, x->nfq + x->nfu, x->np, x->ni, x->ny, x->model->nindicators};
    unsigned first = 0;
    for (int kind = OF_TIME; kind < OF_NOTHING; first += (unsigned)sizes[kind++])
        if (variable - first < (unsigned)sizes[kind]) {
            *index = (int)(variable - first);
            return kind;
        }
    return OF_NOTHING;
}

const char *unit_name(const unit *x, unsigned variable)
{
    int index;
    return unit_of(x, variable, &index) == OF_NOTHING ? "(unknown)" : x->model->variables[variable];
}

/* Position among the states of an independent coordinate or speed; -1 for others. */
static int state_of(const unit *x, int kind, int index)
{
    const int n = kind == OF_Q ? x->nfq : x->nfu;
    const int *const entries = kind == OF_Q ? x->system->free_q : x->system->free_u;
    for (int i = 0; i < n; ++i)
        if (entries[i] == index) return kind == OF_Q ? i : x->nfq + i;
    return -1;
}

/* Whether a call is allowed in the current mode; `modes` has a bit for each allowed one. */
int unit_in(unit *x, const char *call, unsigned modes)
{
    static const char *const names[] = {
        "Instantiated", "Initialization Mode", "Event Mode", "Continuous-Time Mode", "Step Mode", "Terminated"};
    const int mode = (int)*x->mode;
    if (modes >> mode & 1u) return UNIT_OK;
    return unit_say(x, UNIT_ERROR, "%s must not be called in the state %s", call, names[mode]);
}

/* A function whose sign changes at an event; `slope` is its derivative with respect to the switching function. For an angle, the event is
 * at half a turn. */
scalar unit_indicator(const unit *x, int i, scalar *slope)
{
    const int k = x->model->indicators[i];
    const scalar g = x->switches[k];
    const int is_angle = x->system->switch_kind[k] == ORDERNM_TURN;
    *slope = is_angle ? -2.0*g : 1.0;
    return is_angle ? HALF_A_TURN*HALF_A_TURN - g*g : g;
}

int unit_get(unit *x, const unsigned *variables, size_t n, scalar *values)
{
    const ordernm_system *const s = x->system;
    if (unit_has(x, n, variables, values)) return UNIT_ERROR;
    for (size_t i = 0; i < n; ++i) {
        int k;
        scalar slope;
        const int kind = unit_of(x, variables[i], &k);
        if (kind == OF_NOTHING) return unit_say(x, UNIT_ERROR, "there is no variable with the value reference %u", variables[i]);
        if (kind != OF_TIME && kind != OF_PARAMETER && kind != OF_INPUT) {
            const int status = unit_update(x);
            if (status) return status;
        }
        values[i] = kind == OF_TIME ? *x->t : kind == OF_Q ? x->q[k] : kind == OF_U ? x->u[k] : kind == OF_PARAMETER ? x->p[k]
                    : kind == OF_INPUT ? x->inputs[k] : kind == OF_OUTPUT ? x->outputs[k] : kind == OF_SWITCH ? unit_indicator(x, k, &slope)
                    : k < x->nfq ? x->qdot[s->free_q[k]] : x->udot[s->free_u[k - x->nfq]];
    }
    return UNIT_OK;
}

int unit_set(unit *x, const unsigned *variables, size_t n, const scalar *values)
{
    const int mode = (int)*x->mode, before = mode <= INITIALIZING;
    if (unit_has(x, n, variables, values)) return UNIT_ERROR;
    for (size_t i = 0; i < n; ++i) {
        int k;
        const int kind = unit_of(x, variables[i], &k);
        const char *const name = unit_name(x, variables[i]);
        if (kind == OF_NOTHING) return unit_say(x, UNIT_ERROR, "there is no variable with the value reference %u", variables[i]);
        if (!isfinite(values[i])) return unit_say(x, UNIT_ERROR, "the value of %s is not finite", name);
        const int state = kind == OF_Q || kind == OF_U ? state_of(x, kind, k) : -1;
        if (kind == OF_INPUT) x->inputs[k] = values[i];
        else if (kind == OF_PARAMETER && mode != CONTINUOUS_TIME) x->p[k] = values[i];
        else if (state >= 0 && before) {
            (kind == OF_Q ? x->q : x->u)[k] = values[i];
            x->given[state] = 1.0;
        } else if (kind == OF_PARAMETER) {
            return unit_say(x, UNIT_ERROR, "parameter %s can change in Event Mode, but not in Continuous-Time Mode", name);
        } else if (state >= 0) {
            return unit_say(x, UNIT_ERROR, "initial value %s can be set before initialisation ends, but not later", name);
        } else {
            return unit_say(x, UNIT_ERROR, "%s is computed and cannot be set; parameters, inputs and initial values of independent "
                            "coordinates and speeds can", name);
        }
        unit_change(x);
    }
    return UNIT_OK;
}

int unit_set_time(unit *x, scalar t)
{
    if (!isfinite(t)) return unit_say(x, UNIT_ERROR, "the time is not finite");
    if (*x->t != t) unit_change(x);
    *x->t = t;
    return UNIT_OK;
}

static int of_states(unit *x, const scalar *values, size_t n)
{
    const size_t wanted = (size_t)(x->nfq + x->nfu);
    return n == wanted ? unit_has(x, n, values, values) : unit_say(x, UNIT_ERROR, "an array has %zu entries, expected %zu, one for each continuous state", n, wanted);
}

int unit_set_states(unit *x, const scalar *states, size_t n)
{
    const ordernm_system *const s = x->system;
    if (of_states(x, states, n)) return UNIT_ERROR;
    for (size_t i = 0; i < n; ++i)
        if (!isfinite(states[i])) return unit_say(x, UNIT_DISCARD, "continuous state %zu is not finite", i + 1);
    for (int i = 0; i < x->nfq; ++i) x->q[s->free_q[i]] = states[i];
    for (int i = 0; i < x->nfu; ++i) x->u[s->free_u[i]] = states[x->nfq + i];
    unit_change(x);
    return UNIT_OK;
}

int unit_get_states(unit *x, scalar *states, size_t n)
{
    const ordernm_system *const s = x->system;
    if (of_states(x, states, n)) return UNIT_ERROR;
    if (*x->mode <= INITIALIZING && unit_update(x)) return UNIT_ERROR;
    for (int i = 0; i < x->nfq; ++i) states[i] = x->q[s->free_q[i]];
    for (int i = 0; i < x->nfu; ++i) states[x->nfq + i] = x->u[s->free_u[i]];
    return UNIT_OK;
}

int unit_get_rates(unit *x, scalar *rates, size_t n)
{
    const ordernm_system *const s = x->system;
    if (of_states(x, rates, n)) return UNIT_ERROR;
    const int status = unit_update(x);
    if (status) return status;
    for (int i = 0; i < x->nfq; ++i) rates[i] = x->qdot[s->free_q[i]];
    for (int i = 0; i < x->nfu; ++i) rates[x->nfq + i] = x->udot[s->free_u[i]];
    for (size_t i = 0; i < n; ++i)
        if (!isfinite(rates[i]))
            return unit_say(x, unit_trial(x), "at t = %.9g s %s is not finite", *x->t, unit_name(x, 1 + (unsigned)(x->nq + x->nu + (int)i)));
    return UNIT_OK;
}

int unit_get_indicators(unit *x, scalar *values, size_t n)
{
    const size_t wanted = (size_t)x->model->nindicators;
    if (n != wanted) return unit_say(x, UNIT_ERROR, "an array has %zu entries, expected %zu, one for each event indicator", n, wanted);
    int status = unit_has(x, n, values, values);
    if (!status) status = unit_update(x);
    if (status) return status;
    scalar slope;
    for (size_t i = 0; i < n; ++i) values[i] = unit_indicator(x, (int)i, &slope);
    return UNIT_OK;
}

int unit_get_nominals(unit *x, scalar *nominals, size_t n)
{
    if (of_states(x, nominals, n)) return UNIT_ERROR;
    for (size_t i = 0; i < n; ++i) nominals[i] = 1.0;
    return UNIT_OK;
}

/* ---- Initialisation and events. ---- */

int unit_start(unit *x, scalar t, scalar tolerance, scalar stop)
{
    if (unit_set_time(x, t)) return UNIT_ERROR;
    if (!(stop >= t)) return unit_say(x, UNIT_ERROR, "the stop time is %g s, expected a time after the start at %g s", stop, t);
    *x->stop = stop, *x->rtol = tolerance;
    *x->mode = INITIALIZING;
    if (tolerance >= SMALLEST_TOLERANCE && isfinite(tolerance)) return UNIT_OK;
    *x->rtol = tolerance > 0.0 && tolerance < SMALLEST_TOLERANCE ? SMALLEST_TOLERANCE : x->model->rtol;
    return unit_say(x, UNIT_WARNING, "the tolerance is %g, expected %g or more; %g is used instead", tolerance, SMALLEST_TOLERANCE, *x->rtol);
}

/* Whether the initial state is an equilibrium that no longer fits, since the importer has changed parameters. */
static int is_old_equilibrium(const unit *x)
{
    int missing = 0;
    for (int i = 0; i < x->nfq; ++i) missing |= x->given[i] == 0.0;
    return x->model->at_rest && missing && memcmp(x->p, x->model->p, x->np*sizeof(scalar)) != 0;
}

/* Ends initialisation: quaternions are normalised, loops are closed. */
int unit_started(unit *x)
{
    const ordernm_system *const s = x->system;
    for (int i = 0; i < s->nquaternions; ++i) {
        scalar *const e = x->q + s->quaternion[i];
        if (!(e[0]*e[0] + e[1]*e[1] + e[2]*e[2] + e[3]*e[3] > 0.0))
            return unit_say(x, UNIT_ERROR, "quaternion %s, ... is zero", unit_name(x, 1 + (unsigned)s->quaternion[i]));
        ordernm_normalise(e, 0, 0);
    }
    unit_change(x);
    const int status = unit_update(x);
    if (status) return status;
    begin(x, *x->t, 1.0);
    *x->mode = x->integrates ? STEP_MODE : EVENT_MODE;
    if (!is_old_equilibrium(x)) return UNIT_OK;
    return unit_say(x, UNIT_WARNING, "the motion starts in the equilibrium of the default parameters, but other parameters are set: it does "
                    "not start at rest, unless you set the coordinates of their equilibrium");
}

/* Event Mode: the modes of switches become those of the state. `next` is the time of the next event that is known in advance, or infinite.
 * An event counts as reached within rounding errors of the time. */
int unit_events(unit *x, scalar *next)
{
    const scalar rounding = SAME_MOMENT*(1.0 + fabs(*x->t));
    *next = INFINITY;
    if (x->integrates) return UNIT_OK;
    int status = unit_update(x);
    if (status) return status;
    continue_inputs(x, *x->t, 1.0);
    x->problem.end = x->problem.start + rounding/AT_ZERO;
    status = unit_settle(x, rounding);
    if (status == SLIDES)
        return unit_say(x, UNIT_ERROR, "at t = %.9g s, where %s changes its branch, forces on both sides push the motion back, so that it "
                        "sticks or slides there, which neither branch describes; smooth the change, as by tanh or step(x, from, to)",
                        *x->t, x->model->switches[x->results.component]);
    if (status) return unit_failed(x, status);
    return x->model->nscheduled ? unit_next_event(x, *x->t + rounding, next) : UNIT_OK;
}

/* ---- Co-Simulation. ---- */

static int why_it_ended(unit *x, int reason)
{
    const ordernm_results *const r = &x->results;
    const char *const of_switch = x->ns && r->component < x->ns ? x->model->switches[r->component] : "a force";
    const char *text = 0;
    switch (reason) {
    case ORDERNM_SINGULAR: return unit_failed(x, r->singular);
    case ORDERNM_OPEN: return unit_failed(x, -1);
    case ORDERNM_COLLAPSED: text = "steps have become too small; the motion may be unbounded or jump there"; break;
    case ORDERNM_NOT_FINITE: text = "a time derivative is not finite"; break;
    case ORDERNM_MANY_STEPS: text = "too many steps are necessary; loosen the tolerance, or export with method=\"radau\" for stiff models"; break;
    case ORDERNM_UNDETERMINED: text = "the dependent coordinates are poorly determined, as at a dead point; choose other independent "
                                      "coordinates in the model"; break;
    case ORDERNM_APART: text = "a redundant loop condition, which was dropped, would open"; break;
    case ORDERNM_SLIDING:
        return unit_say(x, UNIT_ERROR, "at t = %.9g s, where %s changes its branch, forces on both sides push the motion back, so that it "
                        "sticks or slides there, which neither branch describes; smooth the change, as by tanh or step(x, from, to)",
                        r->t, of_switch);
    case ORDERNM_ACCUMULATED:
        return unit_say(x, UNIT_ERROR, "at t = %.9g s %s changes its branch faster and faster; smooth the change, as by tanh or "
                        "step(x, from, to)", r->t, of_switch);
    default: text = "the integrator stopped";
    }
    return unit_say(x, UNIT_ERROR, "the motion ends at t = %.9g s: %s", r->t, text);
}

/* Integrates to the end of a step. */
static int integrate(unit *x, scalar h)
{
    int reason;
    do reason = ordernm_go(x->motion, &x->results, AT_ANY_TIME);
    while (reason == ORDERNM_PAUSED);
    if (reason != ORDERNM_ENDED) return why_it_ended(x, reason);
    ordernm_state(x->motion, x->q, x->u);
    *x->step = fmin(x->results.next_step, h) > 0.0 ? x->results.next_step : 0.0;
    return UNIT_OK;
}

/* A step along the tangent, which is exact to rounding if the step is short. */
static void move_straight(unit *x, scalar h)
{
    const ordernm_system *const s = x->system;
    for (int i = 0; i < x->nfq; ++i) x->q[s->free_q[i]] += h*x->qdot[s->free_q[i]];
    for (int i = 0; i < x->nfu; ++i) x->u[s->free_u[i]] += h*x->udot[s->free_u[i]];
    unit_change(x);
}

/* A step of Co-Simulation from the communication point t. Inputs of prescribed motion follow their polynomials; other inputs are
 * constant. */
int unit_step(unit *x, scalar t, scalar h)
{
    const scalar end = t + h;
    if (!(h > 0.0) || !isfinite(end)) return unit_say(x, UNIT_ERROR, "the communication step size is %g s, expected a positive number", h);
    if (!(fabs(t - *x->t) <= SAME_TIME*(1.0 + fabs(t))))
        return unit_say(x, UNIT_ERROR, "the communication point is %.17g s, but the instance is at %.17g s", t, *x->t);
    if (end > *x->stop + SAME_TIME*(1.0 + fabs(end)))
        return unit_say(x, UNIT_ERROR, "the step ends at %.9g s, after the stop time %.9g s of this simulation", end, *x->stop);
    const int status = unit_update(x);
    if (status || !(end > *x->t)) return status; /* the instance may be at the end of a very short step already */
    begin(x, *x->t, end - *x->t);
    x->problem.end = end;
    const int straight = end - *x->t <= SMALLEST_STEP*(1.0 + fabs(end));
    if (straight) move_straight(x, end - *x->t);
    else if (integrate(x, h)) return UNIT_ERROR;
    move_inputs(x, end - *x->t);
    *x->t = end;
    if (!straight) unit_took_step(x);
    return unit_update(x);
}
