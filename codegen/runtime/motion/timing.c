/* How well the times of switches and events are known. An error e of the state moves the zero of a function g by -g_z e/g'. Two such zeros
 * may have exchanged their order if errors as large as the tolerances move one of them past the other. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* Errors of the state in tolerances: the errors of many steps add up. */
static const scalar ERRORS = 10.0;

/* Arguments of a function along an error of the state, at a fixed time. The errors n = 0 and n = 1 change each entry in different
 * proportions. The squares of the two changes of an entry add up to the square of its whole error. Returns the status of a function. */
static int along_error(ordernm_motion *m, scalar t, const scalar *z, int n, ordernm_call *c)
{
    scalar *const error = m->error[1];
    for (int i = 0; i < m->ny; ++i)
        error[i] = ERRORS*(m->problem->atol[i] + m->problem->rtol*fabs(z[i]))*(n ? sin(1.0 + 7.0*i) : cos(1.0 + 7.0*i));
    const int status = ordernm_along_time(m, t, z, error, c);
    memset(m->input_rates, 0, m->system->ninputs*sizeof(scalar));
    c->dt = m->dt;
    return status;
}

/* Errors of all switching functions, in m->switch_errors. Returns the status of a function. */
int ordernm_find_switch_errors(ordernm_motion *m, scalar t, const scalar *z)
{
    const int count = m->system->nswitches;
    int status = 0;
    for (int n = 0; n < 2 && !status; ++n) {
        ordernm_call c;
        if ((status = along_error(m, t, z, n, &c))) return status;
        c.switches = m->switches, c.dswitches = m->dswitches;
        status = ORDERNM_OF(m, switch_sensitivities[ORDERNM_ONE])(&c);
        for (int k = 0; k < count; ++k) m->switch_errors[2*k + n] = m->dswitches[k];
    }
    return status;
}

/* Errors of an output. Returns the status of a function. */
int ordernm_find_output_error(ordernm_motion *m, scalar t, const scalar *z, int output, scalar *error)
{
    int status = 0;
    error[0] = error[1] = 0.0;
    for (int n = 0; n < 2 && !status && m->system->output_sensitivities[ORDERNM_ONE]; ++n) {
        ordernm_call c;
        if ((status = along_error(m, t, z, n, &c))) return status;
        c.outputs = m->outputs, c.doutputs = m->doutputs;
        status = ORDERNM_OF(m, output_sensitivities[ORDERNM_ONE])(&c);
        error[n] = m->doutputs[output];
    }
    return status;
}

/* The error of a switching function in m->switch_errors. */
scalar ordernm_switch_error(const ordernm_motion *m, int k) { return hypot(m->switch_errors[2*k], m->switch_errors[2*k + 1]); }

/* Whether a function's zero, at a given time after that of a switch, may in fact precede it. The function has the given error and rate. */
int ordernm_may_precede(const ordernm_motion *m, scalar after, const scalar *error, scalar rate, int k)
{
    const scalar *const first = m->switch_errors + 2*k, speed = m->passing_speed[k];
    const scalar apart = hypot(error[0]/rate - first[0]/speed, error[1]/rate - first[1]/speed);
    return after <= apart && apart < INFINITY;
}
