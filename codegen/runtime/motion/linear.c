/* Dense linear equations: factors and solutions, by rows, for vector instructions. */
#include "linear.h"

#include <math.h>

static inline void exchange(scalar *x, scalar *y, int count)
{
    if (x == y) return;
    for (int j = 0; j < count; ++j) {
        const scalar z = x[j];
        x[j] = y[j];
        y[j] = z;
    }
}

int ordernm_factorise(int n, scalar *a, int *pivot)
{
    for (int k = 0; k < n; ++k) {
        int best = k;
        for (int i = k + 1; i < n; ++i)
            if (fabs(a[(long)i*n + k]) > fabs(a[(long)best*n + k])) best = i;
        pivot[k] = best;
        scalar *const row = a + (long)k*n;
        exchange(row, a + (long)best*n, n);
        const scalar inverse = row[k] = 1.0/row[k];
        if (!(fabs(inverse) < INFINITY)) return 1;
        for (int i = k + 1; i < n; ++i) {
            scalar *const below = a + (long)i*n;
            const scalar f = below[k] *= inverse;
            if (f != 0.0) subtract_row(below + k + 1, f, row + k + 1, n - k - 1);
        }
    }
    return 0;
}

int ordernm_factorise_complex(int n, scalar *re, scalar *im, int *pivot)
{
    for (int k = 0; k < n; ++k) {
        int best = k;
        scalar largest = -1.0;
        for (int i = k; i < n; ++i) {
            const scalar size = fabs(re[(long)i*n + k]) + fabs(im[(long)i*n + k]);
            if (size > largest) largest = size, best = i;
        }
        pivot[k] = best;
        scalar *const a = re + (long)k*n, *const b = im + (long)k*n;
        exchange(a, re + (long)best*n, n);
        exchange(b, im + (long)best*n, n);
        const scalar square = a[k]*a[k] + b[k]*b[k];
        const scalar x = a[k] /= square, y = b[k] /= -square;
        if (!(fabs(x) + fabs(y) < INFINITY)) return 1;
        for (int i = k + 1; i < n; ++i) {
            scalar *const c = re + (long)i*n, *const d = im + (long)i*n;
            const scalar f = c[k]*x - d[k]*y, g = c[k]*y + d[k]*x;
            c[k] = f, d[k] = g;
            const int left = n - k - 1;
            if (f != 0.0) subtract_row(c + k + 1, f, a + k + 1, left), subtract_row(d + k + 1, f, b + k + 1, left);
            if (g != 0.0) subtract_row(c + k + 1, -g, b + k + 1, left), subtract_row(d + k + 1, g, a + k + 1, left);
        }
    }
    return 0;
}

/* x[j] -= a[j]*y for j < count; x[j] and y are numbers or LANES of them. */
static inline void spread(scalar *x, const scalar *a, const scalar *y, int count, int width)
{
    if (width == 1) {
        subtract_row(x, y[0], a, count);
        return;
    }
    for (int j = 0; j < count; ++j) subtract_row(x + (long)j*width, a[j], y, width);
}

static inline void solve(int n, const scalar *a, const int *pivot, scalar *x, int width)
{
    for (int k = 0; k < n; ++k) exchange(x + (long)k*width, x + (long)pivot[k]*width, width);
    for (int i = 1; i < n; ++i) subtract(x + (long)i*width, a + (long)i*n, x, i, width);
    for (int i = n - 1; i >= 0; --i) {
        scalar *const at = x + (long)i*width;
        const scalar *const row = a + (long)i*n + i;
        subtract(at, row + 1, at + width, n - 1 - i, width);
        for (int l = 0; l < width; ++l) at[l] *= row[0];
    }
}

static inline void solve_transposed(int n, const scalar *a, const int *pivot, scalar *x, int width)
{
    for (int i = 0; i < n; ++i) {
        scalar *const at = x + (long)i*width;
        const scalar *const row = a + (long)i*n;
        for (int l = 0; l < width; ++l) at[l] *= row[i];
        spread(at + width, row + i + 1, at, n - 1 - i, width);
    }
    for (int i = n - 1; i > 0; --i) spread(x, a + (long)i*n, x + (long)i*width, i, width);
    for (int k = n - 1; k >= 0; --k) exchange(x + (long)k*width, x + (long)pivot[k]*width, width);
}

static inline void solve_complex(int n, const scalar *re, const scalar *im, const int *pivot, scalar *x, scalar *y,
    scalar *z, int width)
{
    for (int k = 0; k < n; ++k) {
        exchange(x + (long)k*width, x + (long)pivot[k]*width, width);
        exchange(y + (long)k*width, y + (long)pivot[k]*width, width);
    }
    for (int i = 0; i < n; ++i) {
        scalar *const at = x + (long)i*width, *const at_im = y + (long)i*width;
        const scalar *const a = re + (long)i*n, *const b = im + (long)i*n;
        subtract(at, a, x, i, width);
        subtract(at, b, z, i, width);
        subtract(at_im, a, y, i, width);
        subtract(at_im, b, x, i, width);
        for (int l = 0; l < width; ++l) z[(long)i*width + l] = -at_im[l];
    }
    for (int i = n - 1; i >= 0; --i) {
        scalar *const at = x + (long)i*width, *const at_im = y + (long)i*width, *const minus_im = z + (long)i*width;
        const scalar *const a = re + (long)i*n + i, *const b = im + (long)i*n + i;
        const int left = n - 1 - i;
        subtract(at, a + 1, at + width, left, width);
        subtract(at, b + 1, minus_im + width, left, width);
        subtract(at_im, a + 1, at_im + width, left, width);
        subtract(at_im, b + 1, at + width, left, width);
        for (int l = 0; l < width; ++l) {
            const scalar c = at[l], d = at_im[l];
            at[l] = a[0]*c - b[0]*d;
            at_im[l] = a[0]*d + b[0]*c;
            minus_im[l] = -at_im[l];
        }
    }
}

/* x[j] += a[j]*y, as above. */
static inline void spread_back(scalar *x, const scalar *a, const scalar *y, int count, int width)
{
    if (width == 1) {
        subtract_row(x, -y[0], a, count);
        return;
    }
    for (int j = 0; j < count; ++j) subtract_row(x + (long)j*width, -a[j], y, width);
}

static inline void solve_complex_transposed(int n, const scalar *re, const scalar *im, const int *pivot, scalar *x, scalar *y,
    int width)
{
    for (int i = 0; i < n; ++i) {
        scalar *const at = x + (long)i*width, *const at_im = y + (long)i*width;
        const scalar *const a = re + (long)i*n + i, *const b = im + (long)i*n + i;
        const int left = n - 1 - i;
        for (int l = 0; l < width; ++l) {
            const scalar c = at[l], d = at_im[l];
            at[l] = a[0]*c - b[0]*d;
            at_im[l] = a[0]*d + b[0]*c;
        }
        spread(at + width, a + 1, at, left, width);
        spread(at_im + width, a + 1, at_im, left, width);
        spread(at_im + width, b + 1, at, left, width);
        spread_back(at + width, b + 1, at_im, left, width);
    }
    for (int i = n - 1; i > 0; --i) {
        const scalar *const at = x + (long)i*width, *const at_im = y + (long)i*width;
        const scalar *const a = re + (long)i*n, *const b = im + (long)i*n;
        spread(x, a, at, i, width);
        spread(y, a, at_im, i, width);
        spread(y, b, at, i, width);
        spread_back(x, b, at_im, i, width);
    }
    for (int k = n - 1; k >= 0; --k) {
        exchange(x + (long)k*width, x + (long)pivot[k]*width, width);
        exchange(y + (long)k*width, y + (long)pivot[k]*width, width);
    }
}

/* ---- Calls with a constant number of lanes. ---- */

void ordernm_solve(int n, const scalar *a, const int *pivot, scalar *x, int width)
{
    if (width == 1) solve(n, a, pivot, x, 1);
    else if (width == LANES) solve(n, a, pivot, x, LANES);
    else solve(n, a, pivot, x, width);
}

void ordernm_solve_transposed(int n, const scalar *a, const int *pivot, scalar *x, int width)
{
    if (width == 1) solve_transposed(n, a, pivot, x, 1);
    else if (width == LANES) solve_transposed(n, a, pivot, x, LANES);
    else solve_transposed(n, a, pivot, x, width);
}

void ordernm_solve_complex(int n, const scalar *re, const scalar *im, const int *pivot, scalar *x, scalar *y, scalar *z,
    int width)
{
    if (width == 1) solve_complex(n, re, im, pivot, x, y, z, 1);
    else if (width == LANES) solve_complex(n, re, im, pivot, x, y, z, LANES);
    else solve_complex(n, re, im, pivot, x, y, z, width);
}

void ordernm_solve_complex_transposed(int n, const scalar *re, const scalar *im, const int *pivot, scalar *x, scalar *y,
    int width)
{
    if (width == 1) solve_complex_transposed(n, re, im, pivot, x, y, 1);
    else if (width == LANES) solve_complex_transposed(n, re, im, pivot, x, y, LANES);
    else solve_complex_transposed(n, re, im, pivot, x, y, width);
}
