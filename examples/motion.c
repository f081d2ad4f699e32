/* A four-bar moves for two seconds: its motion from C, with derivatives, an event, and a gradient by the adjoint.
 *
 *     ordernm generate examples/four_bar.yaml -o four_bar
 *     cc -O2 -march=native -I four_bar examples/motion.c four_bar/four_bar.c four_bar/four_bar_motion.c four_bar/motion/[a-z]*.c \
 *        -lm -o motion
 *
 * What is asked for is an ordernm_problem; memory is the caller's, as are rows of results. See motion/motion.h.
 */
#include "four_bar.h"
#include "four_bar_model.h"
#include "motion/motion.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const ordernm_system four_bar_system;

enum { DIRECTIONS = 2, TIMES = 5, ROOM = 3, OUTPUTS = 5, EVENTS = 8 };

/* Memory as it comes, so that nobody counts on zeros. */
static double *numbers(long n)
{
    double *const found = malloc((size_t)n*sizeof(double));
    if (!found) exit(2);
    memset(found, 0xff, (size_t)n*sizeof(double));
    return found;
}

static double *zeros(long n)
{
    double *const found = numbers(n);
    for (long i = 0; i < n; ++i) found[i] = 0.0;
    return found;
}

int main(void)
{
    const ordernm_system *const s = &four_bar_system;
    const double times[TIMES] = {0.0, 0.4, 0.5, 0.6, 2.0}, atol[3] = {1e-9, 1e-9, 1e-9};
    const int integrals[] = {3}; /* the kinetic energy */
    const ordernm_event events[] = {{.output = 1, .level = 0.35, .direction = 0, .stop = 0}};
    const double motor[] = {0.3};
    double dp[DIRECTIONS*FOUR_BAR_NP] = {0.0};
    dp[FOUR_BAR_P_crank_length] = 1.0;
    dp[FOUR_BAR_NP + FOUR_BAR_P_base] = 1.0;

    double q[FOUR_BAR_NQ], u[FOUR_BAR_NU];
    memcpy(q, FOUR_BAR_INITIAL_Q, sizeof q);
    memcpy(u, FOUR_BAR_INITIAL_U, sizeof u);
    const ordernm_problem problem = {
        .system = s, .method = ORDERNM_DOP853, .p = FOUR_BAR_PARAMETERS, .q = q, .u = u,
        .ndirections = DIRECTIONS, .dp = dp, .inputs = {.count = 1, .values = motor},
        .start = times[0], .end = times[TIMES - 1], .ntimes = TIMES, .times = times, .rtol = 1e-9, .atol = atol,
        .nintegrals = 1, .integrals = integrals, .nevents = 1, .events = events,
    };

    /* forward: there is room for three rows and eight steps at a time */
    const long row = ordernm_row_size(&problem), met_row = ordernm_event_size(&problem), step = ordernm_step_size(&problem);
    double *const rows = numbers(ROOM*row), *const met = numbers(EVENTS*met_row);
    int which[EVENTS];
    double *const room = numbers(ordernm_room(&problem));
    ordernm_motion *const motion = ordernm_begin(&problem, room);
    ordernm_results results = {
        .rows = rows, .capacity = ROOM, .events = met, .which = which, .events_capacity = EVENTS,
    };
    long steps = 0, room_for_steps = 8;
    double *kept = numbers(room_for_steps*step);
    results.steps = kept;
    results.steps_capacity = room_for_steps;
    int reason;
    do {
        reason = ordernm_go(motion, &results, 0.1);
        for (long i = 0; i < results.count; ++i) {
            const double *const r = rows + i*row, *const outputs = r + 1 + FOUR_BAR_NQ + FOUR_BAR_NU;
            const double *const doutputs = outputs + OUTPUTS + 1 + DIRECTIONS*(FOUR_BAR_NQ + FOUR_BAR_NU);
            printf("row %.17g %.17g %.17g %.17g\n", r[0], outputs[0], doutputs[0], doutputs[OUTPUTS]);
        }
        results.count = 0;
        for (long i = 0; i < results.events_count; ++i) printf("event %.17g %d\n", met[i*met_row], which[i]);
        results.events_count = 0;
        steps = results.steps_count;
        if (steps == room_for_steps) {
            room_for_steps *= 2;
            kept = realloc(kept, (size_t)(room_for_steps*step)*sizeof(double));
            if (!kept) return 2;
            memset(kept + steps*step, 0xff, (size_t)((room_for_steps - steps)*step)*sizeof(double));
            results.steps = kept;
            results.steps_capacity = room_for_steps;
        }
    } while (reason == ORDERNM_PAUSED || reason == ORDERNM_FULL || reason == ORDERNM_IMPRECISE);
    if (reason != ORDERNM_ENDED) {
        fprintf(stderr, "the motion ends at %g s: %d\n", results.t, reason);
        return 1;
    }

    /* backwards: the last trace_x, and the integral of kinetic energy, by all parameters, the initial state and the motor */
    enum { FUNCTIONALS = 2 };
    double *const weights = zeros(FUNCTIONALS*TIMES*OUTPUTS), integral_weights[FUNCTIONALS] = {0.0, 1.0};
    weights[(TIMES - 1)*OUTPUTS] = 1.0;
    ordernm_gradients gradients = {
        .nfunctionals = FUNCTIONALS, .ntimes = TIMES, .times = times, .weights = weights, .integral_weights = integral_weights,
        .q = zeros(FUNCTIONALS*FOUR_BAR_NQ), .u = zeros(FUNCTIONALS*FOUR_BAR_NU), .p = zeros(FUNCTIONALS*FOUR_BAR_NP),
        .inputs = zeros(FUNCTIONALS),
    };
    double *const back_room = numbers(ordernm_adjoint_room(&problem, &gradients));
    ordernm_adjoint *const adjoint = ordernm_adjoint_begin(&problem, &gradients, back_room);
    reason = ordernm_backwards(adjoint, kept, steps);
    ordernm_adjoint_end(adjoint);
    for (int f = 0; f < FUNCTIONALS && reason == ORDERNM_ENDED; ++f) {
        printf("gradient");
        for (int i = 0; i < FOUR_BAR_NP; ++i) printf(" %.17g", gradients.p[f*FOUR_BAR_NP + i]);
        printf(" %.17g %.17g %.17g\n", gradients.q[f*FOUR_BAR_NQ], gradients.u[f*FOUR_BAR_NU], gradients.inputs[f]);
    }
    double *const own[] = {rows, met, room, kept, weights, back_room, gradients.q, gradients.u, gradients.p, gradients.inputs};
    for (size_t i = 0; i < sizeof own/sizeof *own; ++i) free(own[i]);
    return reason != ORDERNM_ENDED;
}
