/* calls.h: calls of the functions of a package from its Python run time, along any number of directions. NAME_calls.c includes this
 * file and defines
 *
 *     number              scalar type of the package
 *     Q, U, ..., RESULTS  indices of pointers in x, arguments and seeds first; size[] contains their numbers of entries
 *     ARGUMENTS, FIRST_SEED, CHECKED, KEPT, UNFIT, NOT_FINITE, FEW_LACK
 *     MOST_WIDTHS, MOST_SEEDS, MOST_RESULTS
 *     QUATERNIONS         indices of quaternions in q, if there are any
 *     FEW_ELSEWHERE       if functions for few directions are in another library
 *     CALL(name), OVER    names of the functions defined here
 *
 * x contains pointers. Bits of `given` mark the arguments and seeds that are present. Missing p and inputs have their default
 * values; missing seeds are zero. With the bit CHECKED, numbers are not tested.
 * Directions are rows: x[DQ] points to [k][NQ]. x[STEPS], if not 0, points to longs: the distances of directions in memory, for
 * seeds and results by their indices in x.
 * Calls return the status of the function; UNFIT if an argument is not finite or a quaternion is too short; NOT_FINITE if a
 * result is not finite; FEW_LACK if a function is in a library that is not open. */
#include <string.h>

#if defined(__OPTIMIZE__) && defined(__GNUC__) && !defined(__clang__)
/* This code only copies numbers: a higher level takes longer to compile, without faster calls. */
#pragma GCC optimize ("O1")
#endif

static int all_finite(const number *x, long n)
{
    const number *const end = x + n;
    number a = 0, b = 0, c = 0, d = 0; /* four independent sums, because each addition has a latency */
    for (; end - x >= 4; x += 4) {
        a += 0*x[0];
        b += 0*x[1];
        c += 0*x[2];
        d += 0*x[3];
    }
    for (; x < end; ++x) a += 0*x[0];
    return (a + b) + (c + d) == 0;
}

static int unfit(number *const *x, long given, number t, long k)
{
    if (given & CHECKED) return 0;
    if (!all_finite(&t, 1)) return 1;
    for (int i = 0; i < ARGUMENTS; ++i)
        if (given >> i & 1 && !all_finite(x[i], i < FIRST_SEED ? size[i] : k*size[i])) return 1;
#ifdef QUATERNIONS
    static const int quaternions[] = {QUATERNIONS};
    for (int i = 0; given >> Q & 1 && i < (int)(sizeof quaternions/sizeof *quaternions); ++i) {
        const number *const e = x[Q] + quaternions[i];
        if (!(e[0]*e[0] + e[1]*e[1] + e[2]*e[2] + e[3]*e[3] >= (number)1e-12)) return 1;
    }
#endif
    return 0;
}

/* One call. Seeds and results along `width` directions are in lanes; missing arguments have their defaults. */
typedef struct {
    number *const *x;
    number *lanes;
    int width;
    const number *p, *inputs;
    double t;
} call;

/* A function of the header: its numbers of directions, increasing; its seeds, stored in lanes; the numbers of entries of its results,
 * negative for results along directions, which follow the seeds. Zeros end the lists. */
typedef struct {
    int (*run)(const call *c);
    int widths[MOST_WIDTHS], seeds[MOST_SEEDS], results;
    long entries[MOST_RESULTS];
} function;

/* Distance in memory between directions of a seed or result with n entries. */
static long step_of(number *const *x, long at, long n)
{
    return x[STEPS] ? ((const long *)x[STEPS])[at] : n;
}

/* The bit with which OVER marks a seed that all states share, and that is already in the lanes. */
static long kept(int seed)
{
    return (long)KEPT << (seed - FIRST_SEED);
}

/* Copies m rows of a seed, from row `start` on, to lanes with the direction as the last index; zeros if the seed is missing. */
static void spread(number *lanes, number *const *x, long given, int seed, long start, long m, int width)
{
    const long n = size[seed], step = step_of(x, seed, n);
    if (m < width || !(given >> seed & 1)) memset(lanes, 0, n*width*sizeof *lanes);
    if (!(given >> seed & 1)) return;
    const number *const rows = x[seed] + start*step;
    for (long i = 0; i < n; ++i)
        for (int l = 0; l < m; ++l) lanes[i*width + l] = rows[l*step + i];
}

static void gather(number *rows, long step, const number *lanes, long n, long m, int width)
{
    for (long i = 0; i < n; ++i)
        for (int l = 0; l < m; ++l) rows[l*step + i] = lanes[i*width + l];
}

/* Calls a function along k directions, several at a time, or once if the function has no directions. */
static int run(const function *f, number *const *x, long given, double t, long k)
{
    if (unfit(x, given, t, k)) return UNFIT;
    call c = {x, x[LANES], 0, x[given >> P & 1 ? P : DEFAULT_P], x[given >> INPUTS & 1 ? INPUTS : DEFAULT_INPUTS], t};
    long start = 0;
    do {
        const int *width = f->widths; /* without directions, values are still computed, by the first available function */
        while (width[0] && width[1] && (start == k || width[0] < k - start)) ++width;
#ifdef FEW_ELSEWHERE
        void *const *const few = (void *const *)x[FEW];
        while (width[0] && width[1] && few[0]) ++width;
        if (width[0] && width[1] && !few[1]) return FEW_LACK;
#endif
        c.width = *width;
        const long m = k - start < c.width ? k - start : c.width;
        number *at = c.lanes;
        for (const int *seed = f->seeds; *seed; at += c.width*size[*seed++])
            if (m < k || !(given & kept(*seed))) spread(at, x, given, *seed, start, m, c.width);
        const int status = f->run(&c);
        if (status) return status;
        for (int i = 0; i < f->results; ++i) {
            const long n = -f->entries[i];
            if (n <= 0) continue;
            const long step = step_of(x, RESULTS + i, n);
            gather(x[RESULTS + i] + start*step, step, at, n, m, c.width);
            at += c.width*n;
        }
        start += m;
    } while (c.width && start < k);
    for (int i = 0; i < f->results && !(given & CHECKED); ++i) {
        const long n = f->entries[i];
        if (x[RESULTS + i] && !all_finite(x[RESULTS + i], n < 0 ? -n*k : n)) return NOT_FINITE;
    }
    return 0;
}

#define X(i) c->x[i]
#define ALONG(i) (c->lanes + c->width*(i))
#define FUNCTION(name, ...) \
    int CALL(name)(number *const *x, long given, double t, long k) \
    { \
        static const function f = {run_##name, __VA_ARGS__}; \
        return run(&f, x, given, t, k); \
    }

/* Calls a function for states *n to end - 1, or until a call fails. `moves` contains pairs of a pointer's index and its stride. */
int OVER(int (*function)(number *const *, long, double, long), number **x, const long (*moves)[2], long count, long given,
    const double *t, long k, long *n, long end)
{
    int status = 0;
    long same = 0; /* seeds that all states share */
    for (int seed = FIRST_SEED; seed < ARGUMENTS; ++seed) same |= kept(seed);
    for (long i = 0; i < count; ++i)
        if (moves[i][0] >= FIRST_SEED && moves[i][0] < ARGUMENTS) same &= ~kept((int)moves[i][0]);
    while (*n < end && !status) {
        status = function(x, given, t ? t[*n] : 0.0, k);
        ++*n;
        given |= same;
        for (long i = 0; i < count; ++i) x[moves[i][0]] += moves[i][1];
    }
    return status;
}
