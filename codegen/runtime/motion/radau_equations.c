/* The linear equations of Radau IIA: Jacobians, factors of a step's equations, and of the equations of all its stages at once. */
#include "radau.h"

#include <math.h>
#include <string.h>

/* ---- Jacobians. ---- */

/* The Jacobian at a state with closed loops, in double or long double, several columns at a time. Returns the status of a function. */
int ordernm_radau_differentiate(ordernm_motion *m, scalar t, const scalar *z, scalar *jacobian, int precise)
{
    struct radau *const r = m->radau;
    const int n = r->n;
    ++m->results->jacobians;
    memcpy(r->seeded, z, m->values*sizeof(scalar));
    scalar *const seed = r->seeded + m->values;
    const scalar *const rate = r->seeded_rate + m->values;
    for (int first = 0; first < n; first += LANES) {
        const int count = n - first < LANES ? n - first : LANES;
        memset(seed, 0, (long)n*LANES*sizeof(scalar));
        for (int l = 0; l < count; ++l) seed[(long)(first + l)*LANES + l] = 1.0;
        const int status = ordernm_rates_of(m, t, r->seeded, r->seeded_rate, 1, &r->columns,
            RATES | KNOWN_CLOSED | (precise ? PRECISE : 0));
        if (status) return status;
        for (int i = 0; i < n; ++i)
            for (int l = 0; l < count; ++l) {
                const scalar x = rate[(long)i*LANES + l];
                jacobian[(long)i*n + first + l] = x - x == 0.0 ? x : 0.0;
                if (x - x != 0.0) m->radau->infinite[first + l] = 1.0;
            }
    }
    return 0;
}

/* Eliminates coordinates e whose rates are speeds, as the given Jacobians show: x[e] = (b[e] + x[partner])/s, where s is REAL/h or the
 * complex value. The column of J for e, divided by s, is added to the column of the partner; the column times b[e]/s is added to the right
 * side. */
static void reduce(const struct radau *r, int count, scalar *const *jacobian, reduction *to)
{
    const int n = r->n;
    to->order = to->count = 0;
    for (int i = 0; i < n; ++i) {
        int partner = i < r->nq ? n : -1;
        for (int c = 0; c < count && partner >= 0; ++c) {
            const scalar *const row = jacobian[c] + (long)i*n;
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

/* Uses r->jacobian from now on; its factors must be computed. */
void ordernm_radau_take_jacobian(struct radau *r)
{
    const reduction *const by = &r->of_step;
    reduce(r, 1, &r->jacobian, &r->of_step);
    for (int i = 0; i < by->order; ++i)
        for (int e = 0; e < by->count; ++e)
            r->column[(long)i*by->count + e] = -r->jacobian[(long)by->kept[i]*r->n + by->reduced[e]];
    r->h_factored = 0.0;
}

/* ---- The equations of a step: a real and a complex matrix with one Jacobian. ---- */

/* Factors of the real and of the complex matrix, for steps of size h. Returns 1 if a matrix is singular. */
int ordernm_radau_factorise(ordernm_motion *m, scalar h)
{
    struct radau *const r = m->radau;
    const reduction *const by = &r->of_step;
    const int k = by->order, n = r->n;
    const scalar square = RE*RE + IM*IM;
    ++m->results->factorizations;
    r->h_factored = 0.0;
    for (int i = 0; i < k; ++i) {
        scalar *const real = r->real + (long)i*k, *const re = r->re + (long)i*k, *const im = r->im + (long)i*k;
        for (int j = 0; j < k; ++j) {
            real[j] = re[j] = -r->jacobian[(long)by->kept[i]*n + by->kept[j]];
            im[j] = 0.0;
        }
        real[i] += REAL/h;
        re[i] += RE/h;
        im[i] += IM/h;
        for (int e = 0; e < by->count; ++e) {
            const scalar x = h*r->column[(long)i*by->count + e];
            real[by->partner[e]] += x/REAL;
            re[by->partner[e]] += x*(RE/square);
            im[by->partner[e]] -= x*(IM/square);
        }
    }
    if (ordernm_factorise(k, r->real, r->real_pivot) || ordernm_factorise_complex(k, r->re, r->im, r->pivot)) return 1;
    r->h_factored = h;
    return 0;
}

/* Right sides of the factorised equations from b, [n][width]: retained entries of b, plus columns of eliminated entries times b/s. */
static inline void take_kept(const struct radau *r, const scalar *b, const scalar *over, scalar *x, int width)
{
    const reduction *const by = &r->of_step;
    for (int i = 0; i < by->order; ++i) {
        scalar *const at = x + (long)i*width;
        for (int l = 0; l < width; ++l) at[l] = b[(long)by->kept[i]*width + l];
        subtract(at, r->column + (long)i*by->count, over, by->count, width);
    }
}

static inline void give_kept(const struct radau *r, const scalar *x, scalar *b, int width)
{
    const reduction *const by = &r->of_step;
    for (int i = 0; i < by->order; ++i)
        for (int l = 0; l < width; ++l) b[(long)by->kept[i]*width + l] = x[(long)i*width + l];
}

/* Replaces the right sides b, [n][width], by the solutions x of (REAL/h - J) x = b. */
static inline void solve_real_lanes(const struct radau *r, scalar *b, int width)
{
    const reduction *const by = &r->of_step;
    const scalar inverse = r->h_factored/REAL;
    scalar *const x = r->scratch[0], *const over = r->scratch[1];
    for (int e = 0; e < by->count; ++e)
        for (int l = 0; l < width; ++l) over[e*width + l] = inverse*b[(long)by->reduced[e]*width + l];
    take_kept(r, b, over, x, width);
    ordernm_solve(by->order, r->real, r->real_pivot, x, width);
    for (int e = 0; e < by->count; ++e)
        for (int l = 0; l < width; ++l)
            b[(long)by->reduced[e]*width + l] = over[e*width + l] + inverse*x[(long)by->partner[e]*width + l];
    give_kept(r, x, b, width);
}

static inline void solve_complex_lanes(const struct radau *r, scalar *b, scalar *c, int width)
{
    const reduction *const by = &r->of_step;
    const scalar square = RE*RE + IM*IM, re = r->h_factored*RE/square, im = -r->h_factored*IM/square;
    scalar *const x = r->scratch[0], *const y = r->scratch[1], *const z = r->scratch[2];
    scalar *const over = r->scratch[3], *const over_im = r->scratch[4];
    for (int e = 0; e < by->count; ++e)
        for (int l = 0; l < width; ++l) {
            const scalar p = b[(long)by->reduced[e]*width + l], q = c[(long)by->reduced[e]*width + l];
            over[e*width + l] = re*p - im*q;
            over_im[e*width + l] = re*q + im*p;
        }
    take_kept(r, b, over, x, width);
    take_kept(r, c, over_im, y, width);
    ordernm_solve_complex(by->order, r->re, r->im, r->pivot, x, y, z, width);
    for (int e = 0; e < by->count; ++e)
        for (int l = 0; l < width; ++l) {
            const scalar p = x[(long)by->partner[e]*width + l], q = y[(long)by->partner[e]*width + l];
            b[(long)by->reduced[e]*width + l] = over[e*width + l] + re*p - im*q;
            c[(long)by->reduced[e]*width + l] = over_im[e*width + l] + re*q + im*p;
        }
    give_kept(r, x, b, width);
    give_kept(r, y, c, width);
}

void ordernm_radau_solve_real(const struct radau *r, scalar *b, int width)
{
    if (width == 1) solve_real_lanes(r, b, 1);
    else if (width == LANES) solve_real_lanes(r, b, LANES);
    else solve_real_lanes(r, b, width);
}

static void solve_complex(const struct radau *r, scalar *b, scalar *c, int width)
{
    if (width == 1) solve_complex_lanes(r, b, c, 1);
    else if (width == LANES) solve_complex_lanes(r, b, c, LANES);
    else solve_complex_lanes(r, b, c, width);
}

/* Solves the transposed systems: right sides of eliminated coordinates, divided by s, are added to those of their partners; solutions of
 * these coordinates follow from their columns. */
static inline void solve_transposed_lanes(const struct radau *r, scalar *b, scalar *c, scalar *d, int width)
{
    const reduction *const by = &r->of_step;
    const scalar h = r->h_factored, square = RE*RE + IM*IM, real = h/REAL, re = h*RE/square, im = -h*IM/square;
    scalar *const u = r->scratch[0], *const x = r->scratch[1], *const y = r->scratch[2];
    for (int i = 0; i < by->order*width; ++i) {
        const long of = (long)by->kept[i/width]*width + i%width;
        u[i] = b[of], x[i] = c[of], y[i] = d[of];
    }
    for (int e = 0; e < by->count; ++e)
        for (int l = 0; l < width; ++l) {
            const long at = (long)by->partner[e]*width + l, of = (long)by->reduced[e]*width + l;
            u[at] += real*b[of];
            x[at] += re*c[of] - im*d[of];
            y[at] += re*d[of] + im*c[of];
        }
    ordernm_solve_transposed(by->order, r->real, r->real_pivot, u, width);
    ordernm_solve_complex_transposed(by->order, r->re, r->im, r->pivot, x, y, width);
    for (int i = 0; i < by->order; ++i) {
        const scalar *const column = r->column + (long)i*by->count;
        for (int e = 0; e < by->count; ++e) {
            const long of = (long)by->reduced[e]*width;
            subtract_row(b + of, column[e], u + (long)i*width, width);
            subtract_row(c + of, column[e], x + (long)i*width, width);
            subtract_row(d + of, column[e], y + (long)i*width, width);
        }
    }
    for (int e = 0; e < by->count; ++e)
        for (int l = 0; l < width; ++l) {
            const long of = (long)by->reduced[e]*width + l;
            const scalar p = c[of], q = d[of];
            b[of] *= real;
            c[of] = re*p - im*q;
            d[of] = re*q + im*p;
        }
    for (int i = 0; i < by->order*width; ++i) {
        const long of = (long)by->kept[i/width]*width + i%width;
        b[of] = u[i], c[of] = x[i], d[of] = y[i];
    }
}

/* A correction of the stages' entries from `at` on, in r->right: solutions of (L/h - J) dW = T^-1 rate - L/h W. */
static void correction(ordernm_motion *m, scalar h, long at, int width)
{
    struct radau *const r = m->radau;
    const scalar *const x = r->stage[0] + at, *const y = r->stage[1] + at, *const z = r->stage[2] + at;
    const scalar *const f = m->rate[1] + at, *const g = m->rate[2] + at, *const k = m->rate[3] + at;
    const scalar real = REAL/h, re = RE/h, im = IM/h;
    for (int i = 0; i < r->n*width; ++i) {
        scalar w[STAGES], s[STAGES];
        for (int j = 0; j < STAGES; ++j) {
            w[j] = INVERSE[j][0]*x[i] + INVERSE[j][1]*y[i] + INVERSE[j][2]*z[i];
            s[j] = INVERSE[j][0]*f[i] + INVERSE[j][1]*g[i] + INVERSE[j][2]*k[i];
        }
        r->right[0][i] = s[0] - real*w[0];
        r->right[1][i] = s[1] - (re*w[1] - im*w[2]);
        r->right[2][i] = s[2] - (re*w[2] + im*w[1]);
    }
    ordernm_radau_solve_real(r, r->right[0], width);
    solve_complex(r, r->right[1], r->right[2], width);
}

/* Corrects the stages, and leaves the corrections in r->right. */
void ordernm_radau_correct(ordernm_motion *m, scalar h, long at, int width)
{
    struct radau *const r = m->radau;
    correction(m, h, at, width);
    for (int i = 0; i < r->n*width; ++i) {
        const scalar w[STAGES] = {r->right[0][i], r->right[1][i], r->right[2][i]};
        for (int j = 0; j < STAGES; ++j) {
            const scalar change = T[j][0]*w[0] + T[j][1]*w[1] + T[j][2]*w[2];
            r->stage[j][at + i] += change;
            r->right[j][i] = change;
        }
    }
}

/* Solves with the transposed matrix M^T of the stages' equations, as if J were the same at all stages; right is [n][width] for each stage.
 * Since the transformation is transposed, too, the complex pair is conjugate to the pair above. */
void ordernm_radau_precondition_transposed(const struct radau *r, scalar *const *right, scalar *const *mu, int width)
{
    const int n = r->n*width;
    for (int i = 0; i < n; ++i) {
        const scalar x = right[0][i], y = right[1][i], z = right[2][i];
        mu[0][i] = T[0][0]*x + T[1][0]*y + T[2][0]*z;
        mu[1][i] = T[0][1]*x + T[1][1]*y + T[2][1]*z;
        mu[2][i] = -(T[0][2]*x + T[1][2]*y + T[2][2]*z);
    }
    if (width == 1) solve_transposed_lanes(r, mu[0], mu[1], mu[2], 1);
    else if (width == LANES) solve_transposed_lanes(r, mu[0], mu[1], mu[2], LANES);
    else solve_transposed_lanes(r, mu[0], mu[1], mu[2], width);
    for (int i = 0; i < n; ++i) {
        const scalar x = mu[0][i], y = mu[1][i], z = -mu[2][i];
        for (int j = 0; j < STAGES; ++j) mu[j][i] = INVERSE[0][j]*x + INVERSE[1][j]*y + INVERSE[2][j]*z;
    }
}

/* ---- The equations of all stages at once, each with its own Jacobian. ---- */

/* Factorises the equations of all three stages at once: A^-1 dZ/h - J dZ, with J of each stage. If the rate of a coordinate is a speed, dZ
 * of the coordinate is h A times dZ of the speed, plus the coordinate's right side. Returns 1 if the matrix is singular. */
int ordernm_radau_factorise_stages(struct radau *r, scalar h)
{
    const int n = r->n;
    reduction *const by = &r->of_stages;
    reduce(r, STAGES, r->at_stage, by);
    const int k = by->order, size = STAGES*k;
    for (int i = 0; i < STAGES; ++i)
        for (int a = 0; a < k; ++a) {
            scalar *const row = r->whole + (long)(i*k + a)*size;
            const scalar *const J = r->at_stage[i] + (long)by->kept[a]*n;
            memset(row, 0, size*sizeof(scalar));
            for (int b = 0; b < k; ++b) row[i*k + b] = -J[by->kept[b]];
            for (int j = 0; j < STAGES; ++j) {
                row[j*k + a] += A_INVERSE[i][j]/h;
                for (int e = 0; e < by->count; ++e) row[j*k + by->partner[e]] -= h*A[i][j]*J[by->reduced[e]];
            }
        }
    return ordernm_factorise(size, r->whole, r->whole_pivot);
}

/* Computes dZ of a group, which begins at `at`, by the rates along S in r->along. */
static inline void solve_stages_lanes(ordernm_motion *m, scalar h, long at, int width)
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
            scalar *const x = r->of_whole + (long)(i*k + a)*width;
            const scalar *const J = r->at_stage[i] + (long)by->kept[a]*n;
            for (int l = 0; l < width; ++l) x[l] = r->along[i][(long)by->kept[a]*width + l];
            for (int e = 0; e < by->count; ++e)
                for (int l = 0; l < width; ++l) x[l] += J[by->reduced[e]]*r->stage[i][at + (long)by->reduced[e]*width + l];
        }
    ordernm_solve(STAGES*k, r->whole, r->whole_pivot, r->of_whole, width);
    const scalar *const x = r->of_whole, *const y = x + (long)k*width, *const z = y + (long)k*width;
    for (int i = 0; i < STAGES; ++i) {
        scalar *const to = r->stage[i] + at;
        for (int a = 0; a < k; ++a)
            for (int l = 0; l < width; ++l) to[(long)by->kept[a]*width + l] = r->of_whole[(long)(i*k + a)*width + l];
        for (int e = 0; e < by->count; ++e)
            for (int l = 0; l < width; ++l) {
                const long of = (long)by->partner[e]*width + l;
                to[(long)by->reduced[e]*width + l] += h*(A[i][0]*x[of] + A[i][1]*y[of] + A[i][2]*z[of]);
            }
    }
    /* rates at the end of the step, for the error of the next step */
    const scalar *const u = r->stage[0] + at, *const v = r->stage[1] + at, *const w = r->stage[2] + at;
    scalar *const rate = m->rate[STAGES] + at;
    for (int i = 0; i < n*width; ++i) rate[i] = (A_INVERSE[2][0]*u[i] + A_INVERSE[2][1]*v[i] + A_INVERSE[2][2]*w[i])/h;
}

void ordernm_radau_solve_stages(ordernm_motion *m, scalar h, long at, int width)
{
    if (width == 1) solve_stages_lanes(m, h, at, 1);
    else if (width == LANES) solve_stages_lanes(m, h, at, LANES);
    else solve_stages_lanes(m, h, at, width);
}

/* Replaces the right sides in mu[i], [n][width], by the solutions of M^T mu = right, where M = A^-1/h - J is the matrix of the equations
 * for changes of the stages. */
void ordernm_radau_solve_transposed(const struct radau *r, scalar h, scalar *const *mu, int width)
{
    const reduction *const by = &r->of_stages;
    const int n = r->n, k = by->order;
    for (int i = 0; i < STAGES; ++i) {
        scalar *const x = r->of_whole + (long)i*k*width;
        for (int a = 0; a < k; ++a) memcpy(x + (long)a*width, mu[i] + (long)by->kept[a]*width, width*sizeof(scalar));
        for (int e = 0; e < by->count; ++e)
            for (int j = 0; j < STAGES; ++j)
                subtract_row(x + (long)by->partner[e]*width, -h*A[j][i], mu[j] + (long)by->reduced[e]*width, width);
    }
    ordernm_solve_transposed(STAGES*k, r->whole, r->whole_pivot, r->of_whole, width);
    for (int i = 0; i < STAGES; ++i)
        for (int a = 0; a < k; ++a) {
            const scalar *const x = r->of_whole + (long)(i*k + a)*width;
            const scalar *const J = r->at_stage[i] + (long)by->kept[a]*n;
            memcpy(mu[i] + (long)by->kept[a]*width, x, width*sizeof(scalar));
            for (int e = 0; e < by->count; ++e)
                subtract_row(mu[i] + (long)by->reduced[e]*width, -J[by->reduced[e]], x, width);
        }
    for (int e = 0; e < by->count; ++e) {
        scalar *const x = mu[0] + (long)by->reduced[e]*width, *const y = mu[1] + (long)by->reduced[e]*width;
        scalar *const z = mu[2] + (long)by->reduced[e]*width;
        for (int l = 0; l < width; ++l) {
            const scalar u = h*x[l], v = h*y[l], w = h*z[l];
            x[l] = A[0][0]*u + A[1][0]*v + A[2][0]*w;
            y[l] = A[0][1]*u + A[1][1]*v + A[2][1]*w;
            z[l] = A[0][2]*u + A[1][2]*v + A[2][2]*w;
        }
    }
}

/* ---- Rates at stages. ---- */

/* Rates at a stage, along one group or none; derivatives along the group are those at the stage or, with `beginning`, at the start of the
 * step. Stores the dependent coordinates at the stage as predictions. */
int ordernm_radau_rates(ordernm_motion *m, scalar h, int i, const group *g, int beginning, int what)
{
    struct radau *const r = m->radau;
    const long predicted = m->ny + m->nx;
    for (long k = 0; k < m->values; ++k) m->trial[k] = m->z[k] + r->stage[i][k];
    if (g) {
        const long end = g->at + (long)predicted*g->width;
        for (long k = g->at; k < end; ++k) m->trial[k] = beginning ? m->z[k] : m->z[k] + r->stage[i][k];
    }
    if (m->precise_stages >> i & 1u) what |= PRECISE; /* affects only loops that are known to be closed */
    const int status = ordernm_rates_of(m, ordernm_time_of_stage(m->t, h, i), m->trial, m->rate[i + 1], g != 0, g, what);
    if (status) return status;
    if (what & KNOWN_CLOSED) return 0;
    ordernm_note_precise(m, i);
    ordernm_note_condition(m, i + 1, 0);
    for (int k = 0; k < m->nd; ++k) r->stage[i][predicted + k] = m->q[m->dependent[k]] - m->z[predicted + k];
    return 0;
}
