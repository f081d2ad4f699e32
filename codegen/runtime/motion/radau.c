/* Radau IIA of order 5 with three stages, for stiff systems.
 *
 * E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., Springer 1996, section IV.8, and their code
 * RADAU5. The stages z + Z[i] satisfy Z[i] = h*sum(a[i][j]*rate[j]). With A^-1 = T*L*T^-1, where L holds one real eigenvalue
 * and a pair of complex ones, Newton's method on W = T^-1*Z needs one real and one complex factorisation of the size of the
 * state. The Jacobian J is exact; it is kept while Newton's method converges fast, and its factors while the step keeps its size.
 *
 * What is solved for are the n independent coordinates and speeds. Integrals are sums of the stages' outputs afterwards, and
 * predictions of dependent coordinates are what closing the loops has given at a stage in Newton's last iteration.
 *
 * Sensitivities are the derivative of the step that has been made: dZ[i] = h*sum(a[i][j]*D rate[j](S + dZ[j])), linear equations
 * with the exact Jacobian at every stage. Of small systems these Jacobians are formed, and the equations of all three stages are
 * factorised once for all directions; the last Jacobian serves Newton's method in the next step too. Of large ones nobody forms
 * them: the equations are solved in sweeps, in which right sides are what the system's functions give along all directions of a
 * group at once, and the factors at hand correct dZ as they do Z. Either result is as exact as the stages that it is taken at, off
 * by the error of Z times second derivatives. So Newton's method goes on further below the tolerance where there are directions. */
#include "inside.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum {
    STAGES = 3,
    ITERATIONS = 7,
    FIXED_ITERATIONS = 30,    /* where a smaller step is no way out */
    SWEEPS = 12,
    LARGEST_FORMED = 24       /* entries of a system whose Jacobians at the stages are formed */
};

static const double TIME[STAGES] = {0.15505102572168219, 0.64494897427831781, 1.0};

static const double T[STAGES][STAGES] = {
    {0.091232394870892943, -0.14125529502095421, -0.030029194105147424},
    {0.24171793270710702, 0.20412935229379993, 0.38294211275726194},
    {0.96604818261509294, 1.0, 0.0},
};
static const double INVERSE[STAGES][STAGES] = {
    {4.3255798900631554, 0.33919925181580987, 0.54177053993587487},
    {-4.1787185915519047, -0.32768282076106239, 0.47662355450055045},
    {-0.50287263494578688, 2.5719269498556054, -0.59603920482822492},
};

/* L: a real eigenvalue and a complex one, with its conjugate. */
static const double REAL = 3.6378342527444957, RE = 2.6810828736277521, IM = 3.0504301992474106;

static const double A[STAGES][STAGES] = {
    {0.19681547722366043, -0.065535425850198388, 0.023770974348220152},
    {0.39442431473908728, 0.29207341166522846, -0.04154875212599793},
    {0.37640306270046728, 0.51248582618842161, 0.11111111111111111},
};

static const double A_INVERSE[STAGES][STAGES] = {
    {3.2247448713915890, 1.1678400846904055, -0.25319726474218083},
    {-3.5678400846904055, 0.77525512860841096, 1.0531972647421808},
    {5.5319726474218083, -7.5319726474218083, 5.0},
};

/* Of the error estimate. */
static const double E[STAGES] = {-10.048809399827416, 1.3821427331607489, -0.33333333333333333};

/* Newton's method converges so fast that J is kept. */
static const double FAST = 1e-3;

/* What may be left of the stages' equations, in units of the errors allowed. */
static const double SOLVED = 0.03;

/* Stages are this much closer to the solution of their equations where there are directions. */
static const double CLOSER = 1e-2;

/* What is left of sensitivities' equations, relative to them; what rounding may leave of them, relative to their size. */
static const double SWEPT = 1e-12, ROUNDED = 1e-9;

/* Steps keep their size, and factors are kept, if they could be as many times as large. */
static const double KEEP_BELOW = 1.2;

static const double SAFETY = 0.9, LEAST_CHANGE = 0.2, LARGEST_CHANGE = 8.0;

enum { CONVERGED = -100, DIVERGED }; /* beside what functions return */

/* Entries that equations are solved for, and coordinates that follow because their rates are speeds. */
typedef struct {
    int order, count;
    int *kept, *place;        /* [order] entries; [n] each entry's place among them */
    int *reduced, *partner;   /* [count] entries; the places of their rates */
} reduction;

struct radau {
    int n;                    /* independent coordinates and speeds */
    int nq;                   /* coordinates among them */
    reduction of_step, of_stages;
    double *column;           /* [order][count] of -J */
    double *jacobian;         /* [n][n] */
    int formed;               /* Jacobians at the stages are */
    double *at_stage[STAGES], *along[STAGES]; /* [n][n] then, and derivatives of rates along S, [n][LANES] */
    double *whole, *of_whole; /* [3 n][3 n] factors of the three stages' equations, [3 n][LANES] their solutions */
    int *whole_pivot;
    double *real, *re, *im;   /* factors of REAL/h - J and (RE + i IM)/h - J */
    int *real_pivot, *pivot;  /* rows that were exchanged */
    double h_factored;        /* 0: there are no factors */
    group columns;            /* seeds of J's columns, so many at a time */
    double *seeded, *seeded_rate;
    double *stage[STAGES], *last[STAGES]; /* Z of this step, and of the accepted one before */
    double *right[STAGES], *scratch[5];   /* [n][LANES] */
    double *scale;            /* [n] errors allowed */
    int tried, jacobian_here; /* J is that of z */
    int formed_here;          /* so is the Jacobian at the last stage of the step before */
    long segment;             /* of the inputs' spline in the step that was tried last */
    long accepted;            /* steps that there is a Z of */
    double h_last, h_tried, t_tried;
    double leniency;          /* largest estimate of an error, in units of what is allowed to the solution */
    double slowness, sweep_slowness; /* theta/(1 - theta) of Newton's method and of the sweeps */
    double theta, stalled;
    int iterations;
    double error_accepted, h_accepted;
};

/* ---- Memory. ---- */

/* Lays out what the method needs of its own, from a cache line on, where it is said with Jacobians at the stages in any case;
 * returns how many bytes, which is all where at is 0. */
size_t ordernm_radau_layout(ordernm_motion *m, void *at, int formed)
{
    memory of = {at, 0};
    const ordernm_system *s = m->system;
    struct radau none, *r = ordernm_take(&of, sizeof *r);
    if (!at) r = &none;
    memset(r, 0, sizeof *r);
    const int n = r->n = m->ny;
    r->nq = s->nfree_q;
    const long square = (long)n*n;
    reduction *const a = &r->of_step, *const b = &r->of_stages;
    int **indices[] = {&a->kept, &a->place, &a->reduced, &a->partner, &b->kept, &b->place, &b->reduced, &b->partner,
        &r->real_pivot, &r->pivot};
    for (size_t i = 0; i < sizeof indices/sizeof *indices; ++i) *indices[i] = ordernm_take(&of, (n + 1)*sizeof(int));
    r->column = ordernm_numbers(&of, square);
    r->jacobian = ordernm_numbers(&of, (long)n*n);
    /* In calls: three sweeps or more of every group against all columns, and S along every group. Factors of three times the order
     * cost more than sweeps where the order is larger (measured: 0.7 of it at 8, twice as much at 35). */
    r->formed = formed || (m->ngroups && n <= LARGEST_FORMED && (n + LANES - 1)/LANES <= 2*m->ngroups);
    for (int i = 0; i < STAGES && r->formed; ++i) {
        r->at_stage[i] = ordernm_numbers(&of, (long)n*n);
        r->along[i] = ordernm_numbers(&of, (long)n*LANES);
    }
    if (r->formed) {
        r->whole = ordernm_numbers(&of, STAGES*STAGES*square);
        r->of_whole = ordernm_numbers(&of, STAGES*(long)n*LANES);
        r->whole_pivot = ordernm_take(&of, (STAGES*n + 1)*sizeof(int));
    }
    r->real = ordernm_numbers(&of, square), r->re = ordernm_numbers(&of, square), r->im = ordernm_numbers(&of, square);
    r->seeded = ordernm_numbers(&of, m->values + (long)n*LANES);
    r->seeded_rate = ordernm_numbers(&of, m->values + (long)(n + m->nx)*LANES);
    const group columns = {LANES, 1, 0, 0, m->values, ordernm_numbers(&of, (long)s->np*LANES)};
    r->columns = columns;
    for (int i = 0; i < STAGES; ++i) {
        r->stage[i] = ordernm_numbers(&of, m->size);
        r->last[i] = ordernm_numbers(&of, m->size);
        r->right[i] = ordernm_numbers(&of, (long)n*LANES);
    }
    for (int i = 0; i < 5; ++i) r->scratch[i] = ordernm_numbers(&of, (long)n*LANES);
    r->scale = ordernm_numbers(&of, n);
    r->leniency = fmax(0.1*pow(m->problem->rtol > 0.0 ? fmax(m->problem->rtol, 1e-14) : 1e-8, -1.0/3.0), 1.0);
    r->slowness = r->sweep_slowness = 1.0;
    if (at) m->radau = r;
    return of.used;
}

/* ---- Linear equations. ---- */

#ifdef __GNUC__
typedef double eight __attribute__((vector_size(64), aligned(8), may_alias));
#endif

/* x -= sum(a[j]*y[j]) of so many; x and y[j] are numbers or LANES of them. */
static inline void subtract(double *x, const double *a, const double *y, int count, int width)
{
    int j = 0;
#ifdef __GNUC__
    eight sum = {0.0};
    if (width == LANES) {
        for (; j < count; ++j) sum += a[j]**(const eight *)(y + (long)j*LANES);
        *(eight *)x -= sum;
        return;
    }
    if (count >= 8) {
        for (; j + 8 <= count; j += 8) sum += *(const eight *)(a + j)**(const eight *)(y + j);
        *x -= ((sum[0] + sum[4]) + (sum[1] + sum[5])) + ((sum[2] + sum[6]) + (sum[3] + sum[7]));
    }
#endif
    for (; j < count; ++j)
        for (int l = 0; l < width; ++l) x[l] -= a[j]*y[(long)j*width + l];
}

/* x -= f*y, so many numbers. */
static inline void subtract_row(double *x, double f, const double *y, int count)
{
    int j = 0;
#ifdef __GNUC__
    for (; j + 8 <= count; j += 8) *(eight *)(x + j) -= f**(const eight *)(y + j);
#endif
    for (; j < count; ++j) x[j] -= f*y[j];
}

static inline void exchange(double *x, double *y, int count)
{
    if (x == y) return;
    for (int j = 0; j < count; ++j) {
        const double z = x[j];
        x[j] = y[j];
        y[j] = z;
    }
}

/* Rows exchanged, then L\U in place: L with ones on its diagonal, U with its diagonal inverted. Returns 1 if a pivot is zero or
 * not finite. */
static int factorise_real(int n, double *a, int *pivot)
{
    for (int k = 0; k < n; ++k) {
        int best = k;
        for (int i = k + 1; i < n; ++i)
            if (fabs(a[(long)i*n + k]) > fabs(a[(long)best*n + k])) best = i;
        pivot[k] = best;
        double *const row = a + (long)k*n;
        exchange(row, a + (long)best*n, n);
        const double inverse = row[k] = 1.0/row[k];
        if (!(fabs(inverse) < INFINITY)) return 1;
        for (int i = k + 1; i < n; ++i) {
            double *const below = a + (long)i*n;
            const double f = below[k] *= inverse;
            if (f != 0.0) subtract_row(below + k + 1, f, row + k + 1, n - k - 1);
        }
    }
    return 0;
}

static int factorise_complex(int n, double *re, double *im, int *pivot)
{
    for (int k = 0; k < n; ++k) {
        int best = k;
        double largest = -1.0;
        for (int i = k; i < n; ++i) {
            const double size = fabs(re[(long)i*n + k]) + fabs(im[(long)i*n + k]);
            if (size > largest) largest = size, best = i;
        }
        pivot[k] = best;
        double *const a = re + (long)k*n, *const b = im + (long)k*n;
        exchange(a, re + (long)best*n, n);
        exchange(b, im + (long)best*n, n);
        const double square = a[k]*a[k] + b[k]*b[k];
        const double x = a[k] /= square, y = b[k] /= -square;
        if (!(fabs(x) + fabs(y) < INFINITY)) return 1;
        for (int i = k + 1; i < n; ++i) {
            double *const c = re + (long)i*n, *const d = im + (long)i*n;
            const double f = c[k]*x - d[k]*y, g = c[k]*y + d[k]*x;
            c[k] = f, d[k] = g;
            const int left = n - k - 1;
            if (f != 0.0) subtract_row(c + k + 1, f, a + k + 1, left), subtract_row(d + k + 1, f, b + k + 1, left);
            if (g != 0.0) subtract_row(c + k + 1, -g, b + k + 1, left), subtract_row(d + k + 1, g, a + k + 1, left);
        }
    }
    return 0;
}

static inline void solve_factored(int n, const double *a, const int *pivot, double *x, int width)
{
    for (int k = 0; k < n; ++k) exchange(x + (long)k*width, x + (long)pivot[k]*width, width);
    for (int i = 1; i < n; ++i) subtract(x + (long)i*width, a + (long)i*n, x, i, width);
    for (int i = n - 1; i >= 0; --i) {
        double *const at = x + (long)i*width;
        const double *const row = a + (long)i*n + i;
        subtract(at, row + 1, at + width, n - 1 - i, width);
        for (int l = 0; l < width; ++l) at[l] *= row[0];
    }
}

/* The same with the matrix transposed. */
static inline void solve_transposed(int n, const double *a, const int *pivot, double *x, int width)
{
    for (int i = 0; i < n; ++i) {
        double *const at = x + (long)i*width;
        const double *const row = a + (long)i*n;
        for (int l = 0; l < width; ++l) at[l] *= row[i];
        for (int j = i + 1; j < n; ++j) subtract_row(x + (long)j*width, row[j], at, width);
    }
    for (int i = n - 1; i > 0; --i)
        for (int j = 0; j < i; ++j) subtract_row(x + (long)j*width, a[(long)i*n + j], x + (long)i*width, width);
    for (int k = n - 1; k >= 0; --k) exchange(x + (long)k*width, x + (long)pivot[k]*width, width);
}

/* The same, of complex numbers: x + iy; z is for -y. */
static inline void solve_factored_complex(int n, const double *re, const double *im, const int *pivot, double *x, double *y,
    double *z, int width)
{
    for (int k = 0; k < n; ++k) {
        exchange(x + (long)k*width, x + (long)pivot[k]*width, width);
        exchange(y + (long)k*width, y + (long)pivot[k]*width, width);
    }
    for (int i = 0; i < n; ++i) {
        double *const at = x + (long)i*width, *const at_im = y + (long)i*width;
        const double *const a = re + (long)i*n, *const b = im + (long)i*n;
        subtract(at, a, x, i, width);
        subtract(at, b, z, i, width);
        subtract(at_im, a, y, i, width);
        subtract(at_im, b, x, i, width);
        for (int l = 0; l < width; ++l) z[(long)i*width + l] = -at_im[l];
    }
    for (int i = n - 1; i >= 0; --i) {
        double *const at = x + (long)i*width, *const at_im = y + (long)i*width, *const minus_im = z + (long)i*width;
        const double *const a = re + (long)i*n + i, *const b = im + (long)i*n + i;
        const int left = n - 1 - i;
        subtract(at, a + 1, at + width, left, width);
        subtract(at, b + 1, minus_im + width, left, width);
        subtract(at_im, a + 1, at_im + width, left, width);
        subtract(at_im, b + 1, at + width, left, width);
        for (int l = 0; l < width; ++l) {
            const double c = at[l], d = at_im[l];
            at[l] = a[0]*c - b[0]*d;
            at_im[l] = a[0]*d + b[0]*c;
            minus_im[l] = -at_im[l];
        }
    }
}

/* Coordinates whose rates are speeds by some Jacobians are not solved for: x[e] = (b[e] + x[partner])/s where s is REAL/h, or the
 * complex one. Their columns of J, over s, are added to those of their partners, and times b[e]/s to right sides. */
static void reduce(const struct radau *r, int count, double *const *jacobian, reduction *to)
{
    const int n = r->n;
    to->order = to->count = 0;
    for (int i = 0; i < n; ++i) {
        int partner = i < r->nq ? n : -1;
        for (int c = 0; c < count && partner >= 0; ++c) {
            const double *const row = jacobian[c] + (long)i*n;
            int found = 0, at = -1;
            for (int j = 0; j < n; ++j)
                if (row[j] != 0.0) ++found, at = j;
            if (found != 1 || at < r->nq || row[at] != 1.0 || (partner < n && partner != at)) at = -1;
            partner = at;
        }
        if (partner >= 0) {
            to->reduced[to->count] = i;
            to->partner[to->count++] = partner;
        } else {
            to->place[i] = to->order;
            to->kept[to->order++] = i;
        }
    }
    for (int e = 0; e < to->count; ++e) to->partner[e] = to->place[to->partner[e]];
}

/* Returns 1 if a matrix is singular. */
static int factorise(ordernm_motion *m, double h)
{
    struct radau *const r = m->radau;
    const reduction *const by = &r->of_step;
    const int k = by->order, n = r->n;
    const double square = RE*RE + IM*IM;
    ++m->results->factorizations;
    r->h_factored = 0.0;
    for (int i = 0; i < k; ++i) {
        double *const real = r->real + (long)i*k, *const re = r->re + (long)i*k, *const im = r->im + (long)i*k;
        for (int j = 0; j < k; ++j) {
            real[j] = re[j] = -r->jacobian[(long)by->kept[i]*n + by->kept[j]];
            im[j] = 0.0;
        }
        real[i] += REAL/h;
        re[i] += RE/h;
        im[i] += IM/h;
        for (int e = 0; e < by->count; ++e) {
            const double x = h*r->column[(long)i*by->count + e];
            real[by->partner[e]] += x/REAL;
            re[by->partner[e]] += x*(RE/square);
            im[by->partner[e]] -= x*(IM/square);
        }
    }
    if (factorise_real(k, r->real, r->real_pivot) || factorise_complex(k, r->re, r->im, r->pivot)) return 1;
    r->h_factored = h;
    return 0;
}

/* Of b, [n][width], to what is factorised: b of what is kept, and columns times b/s of what is not. */
static inline void take_kept(const struct radau *r, const double *b, const double *over, double *x, int width)
{
    const reduction *const by = &r->of_step;
    for (int i = 0; i < by->order; ++i) {
        double *const at = x + (long)i*width;
        for (int l = 0; l < width; ++l) at[l] = b[(long)by->kept[i]*width + l];
        subtract(at, r->column + (long)i*by->count, over, by->count, width);
    }
}

static inline void give_kept(const struct radau *r, const double *x, double *b, int width)
{
    const reduction *const by = &r->of_step;
    for (int i = 0; i < by->order; ++i)
        for (int l = 0; l < width; ++l) b[(long)by->kept[i]*width + l] = x[(long)i*width + l];
}

/* b, [n][width], from right sides to solutions of (REAL/h - J) x = b. */
static inline void solve_real_lanes(const struct radau *r, double *b, int width)
{
    const reduction *const by = &r->of_step;
    const double inverse = r->h_factored/REAL;
    double *const x = r->scratch[0], *const over = r->scratch[1];
    for (int e = 0; e < by->count; ++e)
        for (int l = 0; l < width; ++l) over[e*width + l] = inverse*b[(long)by->reduced[e]*width + l];
    take_kept(r, b, over, x, width);
    solve_factored(by->order, r->real, r->real_pivot, x, width);
    for (int e = 0; e < by->count; ++e)
        for (int l = 0; l < width; ++l)
            b[(long)by->reduced[e]*width + l] = over[e*width + l] + inverse*x[(long)by->partner[e]*width + l];
    give_kept(r, x, b, width);
}

static inline void solve_complex_lanes(const struct radau *r, double *b, double *c, int width)
{
    const reduction *const by = &r->of_step;
    const double square = RE*RE + IM*IM, re = r->h_factored*RE/square, im = -r->h_factored*IM/square;
    double *const x = r->scratch[0], *const y = r->scratch[1], *const z = r->scratch[2];
    double *const over = r->scratch[3], *const over_im = r->scratch[4];
    for (int e = 0; e < by->count; ++e)
        for (int l = 0; l < width; ++l) {
            const double p = b[(long)by->reduced[e]*width + l], q = c[(long)by->reduced[e]*width + l];
            over[e*width + l] = re*p - im*q;
            over_im[e*width + l] = re*q + im*p;
        }
    take_kept(r, b, over, x, width);
    take_kept(r, c, over_im, y, width);
    solve_factored_complex(by->order, r->re, r->im, r->pivot, x, y, z, width);
    for (int e = 0; e < by->count; ++e)
        for (int l = 0; l < width; ++l) {
            const double p = x[(long)by->partner[e]*width + l], q = y[(long)by->partner[e]*width + l];
            b[(long)by->reduced[e]*width + l] = over[e*width + l] + re*p - im*q;
            c[(long)by->reduced[e]*width + l] = over_im[e*width + l] + re*q + im*p;
        }
    give_kept(r, x, b, width);
    give_kept(r, y, c, width);
}

static void solve_real(const struct radau *r, double *b, int width)
{
    if (width == 1) solve_real_lanes(r, b, 1);
    else solve_real_lanes(r, b, LANES);
}

static void solve_complex(const struct radau *r, double *b, double *c, int width)
{
    if (width == 1) solve_complex_lanes(r, b, c, 1);
    else solve_complex_lanes(r, b, c, LANES);
}

/* The Jacobian at a state whose loops are closed: so many columns at a time. Returns what a function returned. */
static int differentiate(ordernm_motion *m, double t, const double *z, double *jacobian)
{
    struct radau *const r = m->radau;
    const int n = r->n;
    ++m->results->jacobians;
    memcpy(r->seeded, z, m->values*sizeof(double));
    double *const seed = r->seeded + m->values;
    const double *const rate = r->seeded_rate + m->values;
    for (int first = 0; first < n; first += LANES) {
        const int count = n - first < LANES ? n - first : LANES;
        memset(seed, 0, (long)n*LANES*sizeof(double));
        for (int l = 0; l < count; ++l) seed[(long)(first + l)*LANES + l] = 1.0;
        const int status = ordernm_rates_of(m, t, r->seeded, r->seeded_rate, 1, &r->columns, RATES | KNOWN_CLOSED);
        if (status) return status;
        for (int i = 0; i < n; ++i)
            for (int l = 0; l < count; ++l) jacobian[(long)i*n + first + l] = rate[(long)i*LANES + l];
    }
    return 0;
}

/* J at z. */
static int renew(ordernm_motion *m)
{
    struct radau *const r = m->radau;
    const int status = r->formed_here ? 0 : differentiate(m, m->t, m->z, r->jacobian);
    if (status) return status;
    if (r->formed_here) memcpy(r->jacobian, r->at_stage[2], (long)r->n*r->n*sizeof(double));
    const reduction *const by = &r->of_step;
    const int n = r->n;
    reduce(r, 1, &r->jacobian, &r->of_step);
    for (int i = 0; i < by->order; ++i)
        for (int e = 0; e < by->count; ++e)
            r->column[(long)i*by->count + e] = -r->jacobian[(long)by->kept[i]*n + by->reduced[e]];
    r->h_factored = 0.0;
    r->jacobian_here = 1;
    return 0;
}

/* ---- The stages' equations. ---- */

/* Of stages at so many entries from `at` on, a correction to right: solutions of (L/h - J) dW = T^-1 rate - L/h W. */
static inline void correction_lanes(ordernm_motion *m, double h, long at, int width)
{
    struct radau *const r = m->radau;
    const double *const x = r->stage[0] + at, *const y = r->stage[1] + at, *const z = r->stage[2] + at;
    const double *const f = m->rate[1] + at, *const g = m->rate[2] + at, *const k = m->rate[3] + at;
    const double real = REAL/h, re = RE/h, im = IM/h;
    for (int i = 0; i < r->n*width; ++i) {
        double w[STAGES], s[STAGES];
        for (int j = 0; j < STAGES; ++j) {
            w[j] = INVERSE[j][0]*x[i] + INVERSE[j][1]*y[i] + INVERSE[j][2]*z[i];
            s[j] = INVERSE[j][0]*f[i] + INVERSE[j][1]*g[i] + INVERSE[j][2]*k[i];
        }
        r->right[0][i] = s[0] - real*w[0];
        r->right[1][i] = s[1] - (re*w[1] - im*w[2]);
        r->right[2][i] = s[2] - (re*w[2] + im*w[1]);
    }
    solve_real(r, r->right[0], width);
    solve_complex(r, r->right[1], r->right[2], width);
}

static void correction(ordernm_motion *m, double h, long at, int width)
{
    if (width == 1) correction_lanes(m, h, at, 1);
    else correction_lanes(m, h, at, LANES);
}

/* Adds T times the correction to the stages, and leaves what has been added in its place. */
static void correct(struct radau *r, long at, int width)
{
    for (int i = 0; i < r->n*width; ++i) {
        const double w[STAGES] = {r->right[0][i], r->right[1][i], r->right[2][i]};
        for (int j = 0; j < STAGES; ++j) {
            const double change = T[j][0]*w[0] + T[j][1]*w[1] + T[j][2]*w[2];
            r->stage[j][at + i] += change;
            r->right[j][i] = change;
        }
    }
}

static double time_of_stage(const ordernm_motion *m, double h, int i)
{
    return i == STAGES - 1 ? m->t + h : m->t + TIME[i]*h;
}

/* Rates at a stage, along one group or none, whose directions are as at the stage or as at the step's beginning; what predictions
 * of dependent coordinates are there is kept. */
static int rates_at_stage(ordernm_motion *m, double h, int i, const group *g, int beginning, int what)
{
    struct radau *const r = m->radau;
    const long predicted = m->ny + m->nx;
    for (long k = 0; k < m->values; ++k) m->trial[k] = m->z[k] + r->stage[i][k];
    if (g) {
        const long end = g->at + (long)predicted*g->width;
        for (long k = g->at; k < end; ++k) m->trial[k] = beginning ? m->z[k] : m->z[k] + r->stage[i][k];
    }
    const int status = ordernm_rates_of(m, time_of_stage(m, h, i), m->trial, m->rate[i + 1], g != 0, g, what);
    if (status) return status;
    if (!(what & KNOWN_CLOSED))
        for (int k = 0; k < m->nd; ++k) r->stage[i][predicted + k] = m->q[m->dependent[k]] - m->z[predicted + k];
    return 0;
}

/* Newton's method on the stages; limit is what may be left of the change, in units of errors allowed, and usual what has to be
 * reached where rounding keeps it from that. */
static int iterate(ordernm_motion *m, double h, double limit, double usual)
{
    struct radau *const r = m->radau;
    const int n = r->n, fixed = m->problem->fixed, most = fixed ? FIXED_ITERATIONS : ITERATIONS;
    double before = 0.0, ratio_before = 0.0;
    r->slowness = pow(fmax(r->slowness, DBL_EPSILON), 0.8);
    r->theta = FAST;
    for (int k = 1; k <= most; ++k) {
        for (int i = 0; i < STAGES; ++i) {
            const int status = rates_at_stage(m, h, i, 0, 0, RATES);
            if (status) return status;
        }
        correction(m, h, 0, 1);
        double sum = 0.0;
        for (int i = 0; i < n; ++i)
            for (int j = 0; j < STAGES; ++j) {
                const double x = r->right[j][i]/r->scale[i];
                sum += x*x;
            }
        const double size = sqrt(sum/(STAGES*n));
        if (!(size < INFINITY)) return DIVERGED;
        if (k > 1) {
            const double ratio = size/before;
            r->theta = k == 2 ? ratio : sqrt(ratio*ratio_before);
            ratio_before = ratio;
            if (!(r->theta < 0.99)) {
                if (size > usual) return DIVERGED;
                r->theta = 0.5;
            }
            r->slowness = r->theta/(1.0 - r->theta);
            const double end = fixed ? 0.0 : r->slowness*size*pow(r->theta, ITERATIONS - 1 - k);
            if (end > limit && end > usual) {
                /* It would take too many iterations: a step that is as much smaller as they are too slow. */
                const double excess = fmin(fmax(end/limit, 1e-4), 20.0);
                m->advice = 0.8*pow(excess, -1.0/(4 + ITERATIONS - 1 - k));
                return DIVERGED;
            }
        }
        correct(r, 0, 1);
        before = fmax(size, DBL_EPSILON);
        r->iterations = k;
        if (r->slowness*size <= limit) return CONVERGED;
        if (k == most && r->slowness*size <= usual) return CONVERGED;
    }
    return DIVERGED;
}

/* The largest change of a group's directions relative to their size, in coordinates and in speeds; `loose` the same, where what
 * is small beside the other, in the step's time, need not be known as well. Not a number if changes are none. */
static double change_of(const ordernm_motion *m, const group *g, double h, double *loose)
{
    const struct radau *const r = m->radau;
    const int width = g->width, parts[] = {0, m->system->nfree_q, m->ny};
    double size[2][LANES] = {{0.0}}, change[2][LANES] = {{0.0}}, largest = 0.0;
    for (int part = 0; part < 2; ++part)
        for (int i = parts[part]; i < parts[part + 1]; ++i)
            for (int l = 0; l < width; ++l) {
                const long k = (long)i*width + l, at = g->at + k;
                const double S = m->z[at], end = S + r->stage[2][at];
                size[part][l] += S*S + end*end;
                for (int j = 0; j < STAGES; ++j) change[part][l] += r->right[j][k]*r->right[j][k];
            }
    *loose = 0.0;
    for (int l = 0; l < g->used; ++l) {
        const double other[] = {size[0][l] + h*h*size[1][l], size[1][l] + size[0][l]/(h*h)};
        for (int part = 0; part < 2; ++part) {
            if (change[part][l] == 0.0) continue;
            const double x = change[part][l]/size[part][l], y = change[part][l]/other[part];
            if (!(x <= largest)) largest = x;
            if (!(y <= *loose)) *loose = y;
            if (x != x || y != y) return NAN;
        }
    }
    *loose = sqrt(*loose);
    return sqrt(largest);
}

/* A^-1 dZ/h - J dZ at each stage with its own J: all three at once. Coordinates whose rates are speeds are h A times the speeds'
 * and their own right sides. Returns 1 if the matrix is singular. */
static int factorise_stages(struct radau *r, double h)
{
    const int n = r->n;
    reduction *const by = &r->of_stages;
    reduce(r, STAGES, r->at_stage, by);
    const int k = by->order, size = STAGES*k;
    for (int i = 0; i < STAGES; ++i)
        for (int a = 0; a < k; ++a) {
            double *const row = r->whole + (long)(i*k + a)*size;
            const double *const J = r->at_stage[i] + (long)by->kept[a]*n;
            memset(row, 0, size*sizeof(double));
            for (int b = 0; b < k; ++b) row[i*k + b] = -J[by->kept[b]];
            for (int j = 0; j < STAGES; ++j) {
                row[j*k + a] += A_INVERSE[i][j]/h;
                for (int e = 0; e < by->count; ++e) row[j*k + by->partner[e]] -= h*A[i][j]*J[by->reduced[e]];
            }
        }
    return factorise_real(size, r->whole, r->whole_pivot);
}

/* dZ of a group from what rates are along S: for all three stages at once. */
static inline void solve_stages_lanes(ordernm_motion *m, double h, long at, int width)
{
    const struct radau *const r = m->radau;
    const reduction *const by = &r->of_stages;
    const int n = r->n, k = by->order;
    for (int e = 0; e < by->count; ++e)
        for (int i = 0; i < STAGES; ++i)
            for (int l = 0; l < width; ++l) {
                const long of = (long)by->reduced[e]*width + l;
                r->stage[i][at + of] = h*(A[i][0]*r->along[0][of] + A[i][1]*r->along[1][of] + A[i][2]*r->along[2][of]);
            }
    for (int i = 0; i < STAGES; ++i)
        for (int a = 0; a < k; ++a) {
            double *const x = r->of_whole + (long)(i*k + a)*width;
            const double *const J = r->at_stage[i] + (long)by->kept[a]*n;
            for (int l = 0; l < width; ++l) x[l] = r->along[i][(long)by->kept[a]*width + l];
            for (int e = 0; e < by->count; ++e)
                for (int l = 0; l < width; ++l) x[l] += J[by->reduced[e]]*r->stage[i][at + (long)by->reduced[e]*width + l];
        }
    solve_factored(STAGES*k, r->whole, r->whole_pivot, r->of_whole, width);
    const double *const x = r->of_whole, *const y = x + (long)k*width, *const z = y + (long)k*width;
    for (int i = 0; i < STAGES; ++i) {
        double *const to = r->stage[i] + at;
        for (int a = 0; a < k; ++a)
            for (int l = 0; l < width; ++l) to[(long)by->kept[a]*width + l] = r->of_whole[(long)(i*k + a)*width + l];
        for (int e = 0; e < by->count; ++e)
            for (int l = 0; l < width; ++l) {
                const long of = (long)by->partner[e]*width + l;
                to[(long)by->reduced[e]*width + l] += h*(A[i][0]*x[of] + A[i][1]*y[of] + A[i][2]*z[of]);
            }
    }
    /* the rates at the step's end, for the error of the next one */
    const double *const u = r->stage[0] + at, *const v = r->stage[1] + at, *const w = r->stage[2] + at;
    double *const rate = m->rate[STAGES] + at;
    for (int i = 0; i < n*width; ++i) rate[i] = (A_INVERSE[2][0]*u[i] + A_INVERSE[2][1]*v[i] + A_INVERSE[2][2]*w[i])/h;
}

/* The stages' derivatives along the directions of a group, by Jacobians that have been formed. */
static int solve_stages(ordernm_motion *m, double h, const group *g)
{
    struct radau *const r = m->radau;
    for (int i = 0; i < STAGES; ++i) {
        const int status = rates_at_stage(m, h, i, g, 1, RATES | KNOWN_CLOSED);
        if (status) return status;
        memcpy(r->along[i], m->rate[i + 1] + g->at, (long)r->n*g->width*sizeof(double));
    }
    if (g->width == 1) solve_stages_lanes(m, h, g->at, 1);
    else solve_stages_lanes(m, h, g->at, LANES);
    const long end = g->at + (long)r->n*g->width;
    for (int i = 0; i < STAGES; ++i)
        if (!ordernm_all_finite(r->stage[i] + g->at, end - g->at)) return DIVERGED;
    return CONVERGED;
}

/* The Jacobians at the stages, and their equations' factors. */
static int form(ordernm_motion *m, double h, int closed)
{
    struct radau *const r = m->radau;
    for (int i = 0; i < STAGES; ++i) {
        int status = closed ? 0 : rates_at_stage(m, h, i, 0, 0, 0);
        if (status) return status;
        for (long k = 0; k < m->values; ++k) m->trial[k] = m->z[k] + r->stage[i][k];
        if ((status = differentiate(m, time_of_stage(m, h, i), m->trial, r->at_stage[i]))) return status;
    }
    return factorise_stages(r, h) ? DIVERGED : CONVERGED;
}

/* The stages' derivatives along the directions of a group; they begin anywhere. */
static int sweep(ordernm_motion *m, double h, const group *g, int closed)
{
    struct radau *const r = m->radau;
    double before = 0.0;
    r->sweep_slowness = pow(fmax(r->sweep_slowness, DBL_EPSILON), 0.8);
    for (int k = 1; k <= SWEEPS; ++k) {
        for (int i = 0; i < STAGES; ++i) {
            const int status = rates_at_stage(m, h, i, g, 0, RATES | (k > 1 ? KNOWN_CLOSED : closed));
            if (status) return status;
        }
        correction(m, h, g->at, g->width);
        correct(r, g->at, g->width);
        double loose;
        const double size = change_of(m, g, h, &loose);
        if (size != size) return DIVERGED;
        if (k > 1) {
            const double theta = size/before;
            if (size < INFINITY && theta < 1.0) r->sweep_slowness = theta/(1.0 - theta);
            if (!(theta < 0.5) && loose <= ROUNDED) return CONVERGED;
            if (theta > 2.0 && k > 3) return DIVERGED;
        }
        if (r->sweep_slowness*size <= SWEPT) return CONVERGED;
        before = size;
    }
    return DIVERGED;
}

/* ---- Steps. ---- */

/* Factors of Z[i] in the polynomial through the step's beginning and its stages, at theta: z + sum(weight*Z). */
static void weights(double theta, double *w)
{
    for (int j = 0; j < STAGES; ++j) {
        w[j] = theta/TIME[j];
        for (int k = 0; k < STAGES; ++k)
            if (k != j) w[j] *= (theta - TIME[k])/(TIME[j] - TIME[k]);
    }
}

/* Stages begin on the polynomial of the step before. */
static void extrapolate(ordernm_motion *m, double h)
{
    struct radau *const r = m->radau;
    if (!r->accepted) {
        for (int i = 0; i < STAGES; ++i) memset(r->stage[i], 0, m->size*sizeof(double));
        return;
    }
    for (int i = 0; i < STAGES; ++i) {
        double w[STAGES];
        weights(1.0 + TIME[i]*h/r->h_last, w);
        w[2] -= 1.0;
        for (long k = 0; k < m->size; ++k)
            r->stage[i][k] = w[0]*r->last[0][k] + w[1]*r->last[1][k] + w[2]*r->last[2][k];
    }
}

/* J and its factors as they are needed, then Newton's method; with J of an earlier state, once more with that of this one. */
static int stages(ordernm_motion *m, double h, double limit, double usual)
{
    struct radau *const r = m->radau;
    for (;;) {
        int status;
        if (r->theta > FAST && !r->jacobian_here && (status = renew(m))) return status;
        if (r->h_factored != h && factorise(m, h)) return DIVERGED;
        m->advice = 0.0;
        status = iterate(m, h, limit, usual);
        if (status == CONVERGED || r->jacobian_here) return status;
        r->theta = 1.0;
        extrapolate(m, h);
    }
}

/* Integrals, of the values or along a group: the sums of what is integrated at the stages. */
static int integrate(ordernm_motion *m, double h, const group *g, int closed)
{
    struct radau *const r = m->radau;
    for (int i = 0; i < STAGES; ++i) {
        const int status = rates_at_stage(m, h, i, g, 0, INTEGRALS | closed);
        if (status) return status;
    }
    const int width = g ? g->width : 1;
    const long first = (g ? g->at : 0) + (long)m->ny*width, end = first + (long)m->nx*width;
    for (int i = 0; i < STAGES; ++i)
        for (long k = first; k < end; ++k)
            r->stage[i][k] = h*(A[i][0]*m->rate[1][k] + A[i][1]*m->rate[2][k] + A[i][2]*m->rate[3][k]);
    return 0;
}

/* The error along a group, or of the values: (REAL/h - J) error = REAL/h*(...). Integrals feed nothing back. */
static void estimate(ordernm_motion *m, double h, const group *g, const double *rate)
{
    const struct radau *const r = m->radau;
    const int width = g ? g->width : 1;
    const long at = g ? g->at : 0, n = (long)(m->ny + m->nx)*width;
    double *const error = m->error[0] + at;
    for (long k = 0; k < n; ++k)
        error[k] = rate[at + k]
            + (E[0]*r->stage[0][at + k] + E[1]*r->stage[1][at + k] + E[2]*r->stage[2][at + k])/h;
    solve_real(r, error, width);
    for (long k = (long)m->ny*width; k < n; ++k) error[k] *= h/REAL;
}

/* What the estimate, which is of order 3, says of the solution, which is of order 5. RADAU5 allows estimates that grow with the
 * power of 2/3 of the tolerance; that trusts that terms of a series fall as they do in smooth motions of size one. Here they have
 * to be seen to fall: where each is less than that before by one factor, the change of an entry in the step and its error of the
 * fourth power say what that of the sixth is, change*(error/change)^(5/3). A tenth of that trust is used. */
static void judge(ordernm_motion *m, double h, const group *g)
{
    const struct radau *const r = m->radau;
    const int width = g ? g->width : 1;
    const long at = g ? g->at : 0, n = (long)(m->ny + m->nx)*width;
    for (long k = at; k < at + n; ++k) {
        double change = h*fabs(m->rate[0][k]);
        for (int i = 0; i < STAGES; ++i) change = fmax(change, fabs(r->stage[i][k]));
        const double ratio = change/fabs(m->error[0][k]);
        if (ratio > 30.0) m->error[0][k] /= fmin(0.1*cbrt(ratio*ratio), r->leniency);
    }
}

/* What the next step should be, by the error of this one and of that before (K. Gustafsson). */
static double next_step(const ordernm_motion *m, double h, double error)
{
    const struct radau *const r = m->radau;
    if (error != error) return 0.5;
    const double effort = SAFETY*(1 + 2*ITERATIONS)/(r->iterations + 2*ITERATIONS);
    const double safety = effort < SAFETY ? effort : SAFETY;
    double quotient = pow(error, 0.25)/safety;
    if (error < 1.0 && r->error_accepted > 0.0) {
        const double predicted = r->h_accepted/h*pow(error*error/r->error_accepted, 0.25)/SAFETY;
        quotient = fmax(quotient, fmin(predicted, 1.0/LEAST_CHANGE));
    }
    return 1.0/fmin(fmax(quotient, 1.0/LARGEST_CHANGE), 1.0/LEAST_CHANGE);
}

static int radau_step(ordernm_motion *m, double h, double *error)
{
    struct radau *const r = m->radau;
    const ordernm_problem *const p = m->problem;
    if (r->tried && m->t != r->t_tried) { /* the step that was tried last has been accepted */
        for (int i = 0; i < STAGES; ++i) {
            double *const before = r->last[i];
            r->last[i] = r->stage[i];
            r->stage[i] = before;
        }
        r->h_last = r->h_tried;
        r->jacobian_here = 0;
        r->formed_here = r->formed && !m->system->split && m->segment == r->segment;
        ++r->accepted;
    }
    r->tried = 1;
    r->t_tried = m->t;
    r->segment = m->segment;
    r->h_tried = h;
    if (!r->accepted) r->theta = 1.0;
    for (int i = 0; i < r->n; ++i) r->scale[i] = p->atol[i] + p->rtol*fabs(m->z[i]);
    const double least = 10.0*DBL_EPSILON/fmax(p->rtol, 1e-14), usual = fmax(least, SOLVED);
    const double limit = m->ngroups || p->fixed ? fmax(least, CLOSER*usual) : usual;
    extrapolate(m, h);
    int status = stages(m, h, limit, usual);
    if (status == DIVERGED) {
        if (m->advice <= 0.0) m->advice = 0.5;
        *error = NAN;
        return 0;
    }
    if (status != CONVERGED) return status;
    if (m->nx && (status = integrate(m, h, 0, 0))) return status;
    for (long k = 0; k < m->values; ++k) m->next[k] = m->z[k] + r->stage[2][k];
    /* Dependent coordinates by their rates: what loops have been closed with is compared with them. */
    for (long k = m->ny + m->nx; k < m->ny + m->nx + m->nd; ++k)
        m->next[k] = m->z[k] + h*(A[2][0]*m->rate[1][k] + A[2][1]*m->rate[2][k] + A[2][2]*m->rate[3][k]);
    estimate(m, h, 0, m->rate[0]);
    judge(m, h, 0);
    if (p->atol_directions) memset(m->error[0] + m->values, 0, (m->size - m->values)*sizeof(double));
    *error = ordernm_error_norm(m, m->next, m->error[0], m->zeros);
    if (*error > 1.0 && !p->fixed && (!r->accepted || m->rejected_before)) {
        /* Stiff components are filtered once more. */
        estimate(m, h, 0, m->rate[0]);
        for (long k = 0; k < m->values; ++k) m->trial[k] = m->z[k] + (k < m->ny ? m->error[0][k] : 0.0);
        if (!ordernm_rates_of(m, m->t, m->trial, m->rate[1], 0, 0, m->nx ? RATES | INTEGRALS : RATES)) {
            estimate(m, h, 0, m->rate[1]);
            judge(m, h, 0);
            *error = ordernm_error_norm(m, m->next, m->error[0], m->zeros);
        }
    }
    const int refused = !(*error <= 1.0) && !(p->fixed && *error < INFINITY);
    const int closed = m->nx && !m->system->split ? KNOWN_CLOSED : 0;
    int formed = CONVERGED;
    if (r->formed && !refused) {
        r->formed_here = 0;
        formed = form(m, h, closed);
    }
    for (int n = 0; n < m->ngroups && !refused; ++n) {
        const group *const g = m->groups + n;
        const int known = (n > 0 || closed || r->formed) && !m->system->split ? KNOWN_CLOSED : 0;
        status = formed != CONVERGED ? formed : r->formed ? solve_stages(m, h, g) : sweep(m, h, g, known);
        if (status == DIVERGED) {
            r->theta = 1.0;
            m->advice = r->jacobian_here ? 0.5 : 0.999;
            *error = NAN;
            return 0;
        }
        if (status != CONVERGED) return status;
        if (m->nx && (status = integrate(m, h, g, known))) return status;
        const long end = g->at + (long)(m->ny + m->nx)*g->width;
        for (long k = g->at; k < end; ++k) m->next[k] = m->z[k] + r->stage[2][k];
        if (p->atol_directions) {
            estimate(m, h, g, m->rate[0]);
            judge(m, h, g);
        }
    }
    if (!refused && p->atol_directions) *error = ordernm_error_norm(m, m->next, m->error[0], m->zeros);
    double change = next_step(m, h, *error);
    if (p->fixed) *error = *error < INFINITY ? 0.0 : NAN;
    if (*error <= 1.0) {
        if (!m->ngroups) {
            /* What is integrated has been found at this state already. */
            if ((status = ordernm_rates_of(m, m->t + h, m->next, m->rate[3], 0, 0, RATES))) return status;
        }
        r->h_accepted = h;
        r->error_accepted = fmax(1e-2, *error);
        if (change >= 1.0 && change <= KEEP_BELOW) change = 1.0;
    } else if (!r->accepted) {
        change = 0.1;
    }
    m->advice = change;
    return 0;
}

static int radau_complete(ordernm_motion *m, double h)
{
    (void)m, (void)h;
    return 0;
}

static void radau_interpolate(ordernm_motion *m, double h, double theta, double *z)
{
    (void)h;
    static const int every[STAGES] = {0, 1, 2};
    double w[STAGES];
    weights(theta, w);
    ordernm_combine(m->size, z, m->z, 1.0, STAGES, every, w, m->radau->stage);
}

/* ---- Steps run backwards. ---- */

/* The stages z + stage[i] of a step of size h from a state kept at m->t and m->z. Returns 0, what a function returned, or a
 * negative number if they are not found. */
int ordernm_radau_stages(ordernm_motion *m, double h, double *const **stage)
{
    struct radau *const r = m->radau;
    const ordernm_problem *const p = m->problem;
    for (int i = 0; i < r->n; ++i) r->scale[i] = p->atol[i] + p->rtol*fabs(m->z[i]);
    r->accepted = 0;
    r->jacobian_here = r->formed_here = 0;
    r->theta = 1.0;
    extrapolate(m, h);
    const double least = 10.0*DBL_EPSILON/fmax(p->rtol, 1e-14), usual = fmax(least, SOLVED);
    const int status = stages(m, h, fmax(least, CLOSER*usual), usual);
    *stage = r->stage;
    return status == CONVERGED ? 0 : status;
}

/* Jacobians at the stages that have been found, and factors of their equations M dZ = right, M = A^-1/h - J: M is what
 * ordernm_radau_transposed solves with. Returns as above. */
int ordernm_radau_form(ordernm_motion *m, double h)
{
    const int status = form(m, h, 0);
    return status == CONVERGED ? 0 : status;
}

/* mu[i], [n][width] of width 1 or LANES, from right sides to solutions of M^T mu = right. With lambda, the gradient with respect to
 * z + stage[2], as the last of three right sides and zeros as the others, that with respect to z is lambda + sum(J[i]^T mu[i]), and
 * that with respect to what else rates depend on likewise: mu[i] are the seeds of rates' transposes at the stages. What integrals
 * want of a stage is added to its right side. */
void ordernm_radau_transposed(const ordernm_motion *m, double h, double *const *mu, int width)
{
    const struct radau *const r = m->radau;
    const reduction *const by = &r->of_stages;
    const int n = r->n, k = by->order;
    for (int i = 0; i < STAGES; ++i) {
        double *const x = r->of_whole + (long)i*k*width;
        for (int a = 0; a < k; ++a) memcpy(x + (long)a*width, mu[i] + (long)by->kept[a]*width, width*sizeof(double));
        for (int e = 0; e < by->count; ++e)
            for (int j = 0; j < STAGES; ++j)
                subtract_row(x + (long)by->partner[e]*width, -h*A[j][i], mu[j] + (long)by->reduced[e]*width, width);
    }
    solve_transposed(STAGES*k, r->whole, r->whole_pivot, r->of_whole, width);
    for (int i = 0; i < STAGES; ++i)
        for (int a = 0; a < k; ++a) {
            const double *const x = r->of_whole + (long)(i*k + a)*width;
            const double *const J = r->at_stage[i] + (long)by->kept[a]*n;
            memcpy(mu[i] + (long)by->kept[a]*width, x, width*sizeof(double));
            for (int e = 0; e < by->count; ++e)
                subtract_row(mu[i] + (long)by->reduced[e]*width, -J[by->reduced[e]], x, width);
        }
    for (int e = 0; e < by->count; ++e) {
        double *const x = mu[0] + (long)by->reduced[e]*width, *const y = mu[1] + (long)by->reduced[e]*width;
        double *const z = mu[2] + (long)by->reduced[e]*width;
        for (int l = 0; l < width; ++l) {
            const double u = h*x[l], v = h*y[l], w = h*z[l];
            x[l] = A[0][0]*u + A[1][0]*v + A[2][0]*w;
            y[l] = A[0][1]*u + A[1][1]*v + A[2][1]*w;
            z[l] = A[0][2]*u + A[1][2]*v + A[2][2]*w;
        }
    }
}

const method ordernm_radau = {STAGES, STAGES + 1, 4, radau_step, radau_complete, radau_interpolate, 0, 0, 0, 1, 0.0};
