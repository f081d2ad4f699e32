/* Extrema of an output within a step: zeros of the derivative of the polynomial through its values at Chebyshev points. If the output is
 * linear in the state, this polynomial is exact, because interpolants are polynomials of degree 7 or 3. */
#include "inside.h"

#include <math.h>
#include <string.h>

enum { N = EVENT_SAMPLES + 1, BISECTIONS = 40 };

/* cos(pi i/N); the points, relative to the step, are (1 - cos(pi i/N))/2. */
static const scalar COSINE[2*N] = {1.0, 0.92387953251128674, 0.70710678118654752, 0.38268343236508977, 0.0, -0.38268343236508977,
    -0.70710678118654752, -0.92387953251128674, -1.0, -0.92387953251128674, -0.70710678118654752, -0.38268343236508977, 0.0,
    0.38268343236508977, 0.70710678118654752, 0.92387953251128674};

/* Distance of an extremum from the level, relative to the polynomial's range, below which the output may cross the level at the extremum.
 * */
static const scalar SHALLOW = 1e-3;

/* Factor by which the last two coefficients bound the omitted coefficients. */
static const scalar LEFT_OUT = 8.0;

static const scalar INSIDE = 1e-9; /* relative to the step: an output does not cross its level twice so near to an end of the step */

scalar ordernm_event_point(int i) { return 0.5*(1.0 - COSINE[i]); }

/* Coefficients of the sum of Chebyshev polynomials of cos(pi x) that has the given values at the points. */
static void coefficients(const scalar *value, scalar *a)
{
    for (int k = 0; k <= N; ++k) {
        scalar sum = 0.5*(value[0] + (k%2 ? -1.0 : 1.0)*value[N]);
        for (int i = 1; i < N; ++i) sum += value[i]*COSINE[i*k%(2*N)];
        a[k] = (k == 0 || k == N ? 1.0 : 2.0)/(int)N*sum;
    }
}

/* Clenshaw's sum of degree n at t. */
static scalar sum_at(const scalar *a, int n, scalar t)
{
    scalar one = 0.0, two = 0.0;
    for (int k = n; k > 0; --k) {
        const scalar next = 2.0*t*one - two + a[k];
        two = one;
        one = next;
    }
    return t*one - two + a[0];
}

static scalar root(const scalar *a, int n, scalar low, scalar high, scalar at_low)
{
    for (int i = 0; i < BISECTIONS; ++i) {
        const scalar middle = 0.5*(low + high);
        if ((sum_at(a, n, middle) > 0.0) == (at_low > 0.0)) low = middle;
        else high = middle;
    }
    return 0.5*(low + high);
}

/* Positions in (-1, 1), increasing, at which the derivative of a sum of degree N changes sign; returns their number. Between neighbouring
 * zeros of its derivative, a polynomial is monotonic and has at most one zero. So the search starts with the last derivative, a straight
 * line. */
static int turns(const scalar *a, scalar *t)
{
    scalar derivative[N][N + 2];
    memset(derivative, 0, sizeof derivative);
    for (int d = 0; d < N; ++d) { /* the derivative of order d + 1 has degree N - d - 1 */
        const scalar *const of = d ? derivative[d - 1] : a;
        for (int k = N - d; k > 0; --k) derivative[d][k - 1] = derivative[d][k + 1] + 2.0*k*of[k];
        derivative[d][0] *= 0.5;
    }
    int count = 0;
    for (int d = N - 2; d >= 0; --d) {
        scalar found[N], low = -1.0, at_low = sum_at(derivative[d], N - d - 1, -1.0);
        int n = 0;
        for (int i = 0; i <= count; ++i) {
            const scalar high = i < count ? t[i] : 1.0, at_high = sum_at(derivative[d], N - d - 1, high);
            if ((at_low > 0.0) != (at_high > 0.0)) found[n++] = root(derivative[d], N - d - 1, low, high, at_low);
            low = high;
            at_low = at_high;
        }
        memcpy(t, found, n*sizeof(scalar));
        count = n;
    }
    return count;
}

/* Increasing positions in the step of extrema at which an output may cross its level (zero), although all its values at the points have one
 * sign. Returns the number of extrema, at most EVENT_SAMPLES. */
int ordernm_extremes(const scalar *value, scalar *where)
{
    scalar a[N + 1], range = 0.0, t[N];
    coefficients(value, a);
    for (int k = 1; k <= N; ++k) range += fabs(a[k]);
    const scalar uncertain = SHALLOW*range + LEFT_OUT*(fabs(a[N]) + fabs(a[N - 1]));
    if (!(fabs(a[0]) <= range + uncertain)) return 0;
    int found = 0;
    for (int i = turns(a, t) - 1; i >= 0; --i) {
        const scalar x = 0.5*(1.0 - t[i]), p = sum_at(a, N, t[i]);
        if (!(x > INSIDE && x < 1.0 - INSIDE)) continue;
        int next = 1; /* next point */
        while (next < N && ordernm_event_point(next) < x) ++next;
        if (fabs(p) <= uncertain || p*value[next] < 0.0 || p*value[next - 1] < 0.0) where[found++] = x;
    }
    return found;
}
