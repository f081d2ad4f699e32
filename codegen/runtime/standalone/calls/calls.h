/* calls.h: calls of the functions of a package from its Python run time, along any number of directions. NAME_calls.c includes this
 * file and defines
 *
 *     number              scalar type of the package
 *     Q, U, ..., RESULTS  places of pointers in x, arguments and seeds first; size[] has the entries of these
 *     ARGUMENTS, FIRST_SEED, CHECKED, KEPT, UNFIT, NOT_FINITE, FEW_LACK
 *     MOST_WIDTHS, MOST_SEEDS, MOST_RESULTS
 *     QUATERNIONS         places of quaternions in q, if there are any
 *     FEW_ELSEWHERE       if functions along few directions are in another library
 *     CALL(name), OVER    names of the functions defined here
 *
 * x holds pointers. Bits of given say which arguments and seeds are there: p and inputs that are not come from their defaults,
 * seeds are zero. CHECKED among them: no numbers are looked at.
 * Directions are rows: x[DQ] points to [k][NQ]. x[STEPS], if it is not 0, points to longs: how far directions lie apart in
 * memory, for seeds and results by their places in x.
 * Returned is what the function returns; UNFIT if an argument is not finite or a quaternion is too short for a
 * rotation; NOT_FINITE if a result is not; FEW_LACK if a function is in a library that is not open. */
#include <string.h>

#if defined(__OPTIMIZE__) && defined(__GNUC__) && !defined(__clang__)
/* It only carries numbers: more than this takes the compiler longer and no call less. */
#pragma GCC optimize ("O1")
#endif

static int all_finite(const number *x, long n)
{
    const number *const end = x + n;
    number a = 0, b = 0, c = 0, d = 0; /* four sums side by side, since each waits for itself */
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

/* One call. Seeds and results along `width` directions lie in lanes; arguments that are not given have their defaults. */
typedef struct {
    number *const *x;
    number *lanes;
    int width;
    const number *p, *inputs;
    double t;
} call;

/* A function of the header: for how many directions at once there is one, fewest first; seeds, which lie in lanes; how many entries
 * its results have, and minus that of results along directions, which lie behind the seeds. Zeros end the lists. */
typedef struct {
    int (*run)(const call *c);
    int widths[MOST_WIDTHS], seeds[MOST_SEEDS], results;
    long entries[MOST_RESULTS];
} function;

/* How far the directions of a seed or result with n entries lie apart in memory. */
static long step_of(number *const *x, long at, long n)
{
    return x[STEPS] ? ((const long *)x[STEPS])[at] : n;
}

/* The bit by which OVER says that the lanes hold a seed already: it is the same for all states. */
static long kept(int seed)
{
    return (long)KEPT << (seed - FIRST_SEED);
}

/* m rows of a seed, from row start on, with the direction as last index; zeros where there is none. */
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

/* Calls a function along k directions, in turns, or once where it has none. */
static int run(const function *f, number *const *x, long given, double t, long k)
{
    if (unfit(x, given, t, k)) return UNFIT;
    call c = {x, x[LANES], 0, x[given >> P & 1 ? P : DEFAULT_P], x[given >> INPUTS & 1 ? INPUTS : DEFAULT_INPUTS], t};
    long start = 0;
    do {
        const int *width = f->widths; /* without directions there are values still, by the function that is there at first */
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

/* State after state, from number *n to the one before end, up to one that fails: pointers move on, which and by what pairs say. */
int OVER(int (*function)(number *const *, long, double, long), number **x, const long (*moves)[2], long count, long given,
    const double *t, long k, long *n, long end)
{
    int status = 0;
    long same = 0; /* the seeds that do not move */
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
