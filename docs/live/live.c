/* The motion of one design, and its derivatives, for a page.
 *
 * live_model.h, which build.py writes, has the sizes, defaults and arrays of the model: at_q, at_p, ... and run_NAME, which calls a
 * generated function on these arrays. The caller fills at_p, at_inputs, along_p and along_inputs, and calls live_start and live_motion.
 */
#include "live_model.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WIDE = 8 };            /* directions of one call */
enum { MOST_NEWTON = 30 };
enum { MOST_FLAT = 8 };

static const double CLOSED = 1e-10;   /* scaled residual of closed loops */
static const double ROUNDING = 1e-14; /* scaled residual at which Newton's method is not continued */
static const double NEAR = 0.3;       /* rad or m: a longer first step of Newton's method may lead to another branch */
static const double LEAST = 1e-4;     /* smallest part of the way from the default design to the wanted one */

/* Directions: derivatives with respect to the parameters and constant inputs. */
double along_p[LIVE_MOST*LIVE_NP + 1];
double along_inputs[LIVE_MOST*LIVE_NSIGNALS + 1];

/* Of the last motion: number of rows, time reached, accepted and rejected steps, evaluations; the time from which derivatives may not
 * exist, or infinity; whether long double is missing; whether a switch was only touched. */
double live_report[8];

static double initial_dq[LIVE_MOST * LIVE_NQ + 1], initial_du[LIVE_MOST * LIVE_NU + 1];
static ordernm_problem problem;
static double *rows, *frames;

/* Memory for n doubles, which replaces the memory of an earlier call with the same arguments. */
static double *sized(double **memory, long *capacity, long n)
{
    if (n > *capacity) {
        free(*memory);
        *memory = (double *)malloc((unsigned long)n * sizeof(double));
        *capacity = *memory ? n : 0;
    }
    return *memory;
}

static void normalise(double *q)
{
    for (int k = 0; k < LIVE_SYSTEM.nquaternions; ++k) {
        double *const e = q + LIVE_SYSTEM.quaternion[k];
        const double length = sqrt(e[0]*e[0] + e[1]*e[1] + e[2]*e[2] + e[3]*e[3]);
        for (int i = 0; i < 4; ++i) e[i] /= length;
    }
}

/* Closes the loops near q by Newton's method; returns 0 if they are not near q. */
static int close_near(double *q, const double *p, const double *inputs)
{
    static double step[LIVE_NQ + 1], position[LIVE_NCLOSURE + 1], condition[LIVE_NLOOPS + 1];
    double before = INFINITY;
    for (int n = 0; n < MOST_NEWTON; ++n) {
        ordernm_call c = {0};
        c.q = q, c.p = p, c.inputs = inputs, c.step = step, c.position = position, c.condition = condition, c.work = at_work;
        if (LIVE_SYSTEM.closing_step(&c)) return 0;
        double gap = 0.0, size = 0.0;
        for (int i = 0; i < LIVE_SYSTEM.nkept; ++i) gap = fmax(gap, fabs(position[LIVE_SYSTEM.kept[i]]));
        for (int i = 0; i < LIVE_NQ; ++i) size = fmax(size, fabs(step[i]));
        if (!isfinite(gap + size) || (n == 0 && size > NEAR)) return 0;
        if (gap <= ROUNDING || (gap <= fmax(CLOSED, LIVE_SYSTEM.slack) && gap >= before)) return 1;
        for (int i = 0; i < LIVE_NQ; ++i) q[i] += step[i];
        normalise(q);
        before = gap;
    }
    return before <= fmax(CLOSED, LIVE_SYSTEM.slack);
}

/* Initial values at parameters p. The package has those at the default parameters, where the loops are closed; the model's formulas give
 * the change from the defaults to p. */
static int initial(const double *p, double *q, double *u)
{
    memcpy(q, live_initial_q, LIVE_NQ*sizeof *q);
    memcpy(u, live_initial_u, LIVE_NU*sizeof *u);
#ifdef LIVE_INITIAL
    static double q0[LIVE_NQ + 1], u0[LIVE_NU + 1], q1[LIVE_NQ + 1], u1[LIVE_NU + 1];
    ordernm_call at = {0};
    at.p = live_default_p, at.work = at_work;
    if (LIVE_INITIAL(&at, q0, u0)) return 1;
    at.p = p;
    if (LIVE_INITIAL(&at, q1, u1)) return 1;
    for (int i = 0; i < LIVE_NQ; ++i) q[i] = q[i] == q0[i] ? q1[i] : q[i] + (q1[i] - q0[i]);
    for (int i = 0; i < LIVE_NU; ++i) u[i] = u[i] == u0[i] ? u1[i] : u[i] + (u1[i] - u0[i]);
#endif
    return 0;
}

/* Closes the loops at at_p on the branch of the default design: continues the closed state along the straight line between both. */
static int follow(double *q, double *u)
{
    static double p[LIVE_NP + 1], inputs[LIVE_NINPUTS + 1], there[LIVE_NQ + 1], guess[LIVE_NQ + 1];
    if (initial(at_p, q, u)) return 0;
    if (!LIVE_SYSTEM.closing_step) return 1;
    if (initial(live_default_p, there, u)) return 0;
    for (double s = 0.0, part = 1.0; s < 1.0;) {
        const double next = fmin(s + part, 1.0);
        for (int i = 0; i < LIVE_NP; ++i)
            p[i] = next < 1.0 ? live_default_p[i] + next*(at_p[i] - live_default_p[i]) : at_p[i];
        for (int i = 0; i < LIVE_NINPUTS; ++i) inputs[i] = next*at_inputs[i];
        if (initial(p, q, u)) return 0;
        memcpy(guess, there, sizeof guess);
        for (int i = 0; i < LIVE_SYSTEM.nfree_q; ++i) guess[LIVE_SYSTEM.free_q[i]] = q[LIVE_SYSTEM.free_q[i]];
        if (close_near(guess, p, inputs)) {
            memcpy(there, guess, sizeof there);
            s = next, part *= 2.0;
        } else if ((part *= 0.5) < LEAST) {
            return 0;
        }
    }
    memcpy(q, there, LIVE_NQ*sizeof *q);
    return 1;
}

/* Derivatives of the initial state along k directions; the state is in at_q and at_u. */
static int start_along(long k)
{
    memset(initial_dq, 0, sizeof initial_dq);
    memset(initial_du, 0, sizeof initial_du);
    for (long first = 0; first < k; first += WIDE) {
        static double dq[LIVE_NQ*WIDE + 1], du[LIVE_NU*WIDE + 1], dp[LIVE_NP*WIDE + 1], dinputs[LIVE_NINPUTS*WIDE + 1], dt[WIDE];
        static double full_u[LIVE_NU + 1], dfull_q[LIVE_NQ*WIDE + 1], dfull_u[LIVE_NU*WIDE + 1];
        const long n = k - first < WIDE ? k - first : WIDE;
        double *found_q = dq, *found_u = du;
        memset(dq, 0, sizeof dq), memset(du, 0, sizeof du), memset(dp, 0, sizeof dp), memset(dinputs, 0, sizeof dinputs);
        for (long d = 0; d < n; ++d) {
            for (int i = 0; i < LIVE_NP; ++i) dp[i*WIDE + d] = along_p[(first + d)*LIVE_NP + i];
            for (int i = 0; i < LIVE_NSIGNALS; ++i) dinputs[i*WIDE + d] = along_inputs[(first + d)*LIVE_NSIGNALS + i];
        }
        ordernm_call c = {0};
        c.q = at_q, c.u = at_u, c.p = at_p, c.inputs = at_inputs, c.work = at_work;
        c.dq = dq, c.du = du, c.dp = dp, c.dinputs = dinputs, c.dt = dt;
#ifdef LIVE_INITIAL
        static double q0[LIVE_NQ + 1], u0[LIVE_NU + 1];
        if (LIVE_INITIAL_ALONG(&c, q0, u0, dq, du)) return 1;
#endif
        if (LIVE_SYSTEM.completion_sensitivities[ORDERNM_EIGHT]) {
            c.full_u = full_u, c.dfull_q = dfull_q, c.dfull_u = dfull_u;
            if (LIVE_SYSTEM.completion_sensitivities[ORDERNM_EIGHT](&c)) return 1;
            found_q = dfull_q, found_u = dfull_u;
        }
        for (long d = 0; d < n; ++d) {
            for (int i = 0; i < LIVE_NQ; ++i) initial_dq[(first + d)*LIVE_NQ + i] = found_q[i*WIDE + d];
            for (int i = 0; i < LIVE_NU; ++i) initial_du[(first + d)*LIVE_NU + i] = found_u[i*WIDE + d];
        }
    }
    return 0;
}

/* The initial state at at_p and at_inputs, in at_q and at_u, and its derivatives along k directions. Returns 0; 1 if the loops do not
 * close on the branch of the default design; 2 if a loop has lost rank. */
int live_start(long k)
{
    if (!follow(at_q, at_u)) return 1;
    normalise(at_q);
    if (LIVE_SYSTEM.completion) {
        static double full_u[LIVE_NU + 1];
        ordernm_call c = {0};
        c.q = at_q, c.u = at_u, c.p = at_p, c.inputs = at_inputs, c.full_u = full_u, c.work = at_work;
        if (LIVE_SYSTEM.completion(&c)) return 2;
        memcpy(at_u, full_u, LIVE_NU*sizeof(double));
    }
    return start_along(k) ? 2 : 0;
}

/* Frames of all bodies at each row of results. */
static void pose(long count, long size)
{
    for (long n = 0; n < count; ++n) {
        const double *const row = rows + n*size;
        at_t[0] = row[0];
        memcpy(at_q, row + 1, LIVE_NQ*sizeof(double));
        memcpy(at_u, row + 1 + LIVE_NQ, LIVE_NU*sizeof(double));
        run_frames();
        memcpy(frames + n*LIVE_NFRAMES, at_frames, LIVE_NFRAMES*sizeof(double));
    }
}

/* The motion from the state in at_q and at_u for `end` seconds, with results at `count` equal intervals and derivatives along k
 * directions; with steps of a constant size, unless that is 0. Returns the reason for its end, as motion.h numbers them, or -1 if
 * memory is short. */
int live_motion(double end, long count, long k, double tolerance, double step)
{
    static double tolerances[2*LIVE_NQ + LIVE_NU + 1], q[LIVE_NQ + 1], u[LIVE_NU + 1];
    static double *memory[4], flat[MOST_FLAT * (1 + 2*LIVE_NQ)];
    static long capacity[4];
    double *const times = sized(&memory[0], &capacity[0], count + 1);
    if (!times) return -1;
    for (long i = 0; i <= count; ++i) times[i] = i < count ? end*(double)i/(double)count : end;
    for (int i = 0; i < 2*LIVE_NQ + LIVE_NU; ++i) tolerances[i] = tolerance;
    memcpy(q, at_q, sizeof q), memcpy(u, at_u, sizeof u);
    memset(&problem, 0, sizeof problem);
    problem.system = &LIVE_SYSTEM, problem.p = at_p, problem.q = q, problem.u = u;
    problem.method = step > 0.0 ? ORDERNM_RK4 : ORDERNM_DOP853, problem.step = step;
    problem.ndirections = (int)k, problem.dq = initial_dq, problem.du = initial_du, problem.dp = along_p;
    problem.inputs.count = 1, problem.inputs.values = at_inputs, problem.inputs.directions = along_inputs;
    problem.end = end, problem.ntimes = count + 1, problem.times = times, problem.most_steps = 100000;
    problem.rtol = tolerance, problem.atol = tolerances;
    const long size = ordernm_row_size(&problem);
    rows = sized(&memory[1], &capacity[1], (count + 1)*size);
    frames = sized(&memory[2], &capacity[2], (count + 1)*LIVE_NFRAMES);
    double *const room = sized(&memory[3], &capacity[3], ordernm_room(&problem));
    if (!rows || !frames || !room) return -1;
    ordernm_results r = {0};
    r.rows = rows, r.capacity = count + 1, r.flat = k ? flat : 0, r.flat_capacity = MOST_FLAT;
    ordernm_motion *const motion = ordernm_begin(&problem, room);
    int reason = ordernm_go(motion, &r, 0.0);
    if (reason == ORDERNM_IMPRECISE) {
        r.as_is = 1;
        reason = ordernm_go(motion, &r, 0.0);
    }
    pose(r.count, size);
    const double report[] = {
        (double)r.count, r.t, (double)r.accepted, (double)r.rejected, (double)r.evaluations,
        r.flat_count ? flat[0] : INFINITY, r.as_is, r.grazed || r.not_held || r.ordered,
    };
    memcpy(live_report, report, sizeof report);
    return reason;
}

/* Results of the last motion: rows as motion.h describes them, and frames [rows][bodies][18]. */
double *live_rows(void) { return rows; }
double *live_frames(void) { return frames; }
