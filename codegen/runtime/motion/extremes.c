/* Where an output turns within a step: of the polynomial through what it is at Chebyshev's points, all places where its derivative is
 * zero. An output that is linear in the state is such a polynomial itself, for interpolants are: of degree 7, of degree 3. */
#include "inside.h"

#include <math.h>
#include <string.h>

enum { N = EVENT_SAMPLES + 1, BISECTIONS = 40 };

/* cos(pi i/N); the points, in parts of a step, are (1 - cos(pi i/N))/2. */
static const scalar COSINE[2*N] = {1.0, 0.92387953251128674, 0.70710678118654752, 0.38268343236508977, 0.0, -0.38268343236508977,
    -0.70710678118654752, -0.92387953251128674, -1.0, -0.92387953251128674, -0.70710678118654752, -0.38268343236508977, 0.0,
    0.38268343236508977, 0.70710678118654752, 0.92387953251128674};

/* Polynomials that are this near to the level, in parts of their range, may cross it where outputs turn. */
static const scalar SHALLOW = 1e-3;

/* What the last two coefficients, which are small, say of those that are left out. */
static const scalar LEFT_OUT = 8.0;

static const scalar INSIDE = 1e-9; /* in parts of the step: an output that turns as near to an end does not come back before it */

scalar ordernm_event_point(int i) { return 0.5*(1.0 - COSINE[i]); }

/* Coefficients of Chebyshev's polynomials of cos(pi x) that have these values at the points. */
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

/* Places within (-1, 1) where the derivative of a sum of degree N changes sign, rising; how many. Between two neighbouring zeros of its
 * own derivative a polynomial rises or falls, and has one zero at most: from the last derivative, a straight line, on. */
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

/* Where an output turns so that it may cross its level, zero, though its values at the points do not show it: parts of the step, rising.
 * Returns how many there are, at most EVENT_SAMPLES. */
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
        int next = 1; /* point behind it */
        while (next < N && ordernm_event_point(next) < x) ++next;
        if (fabs(p) <= uncertain || p*value[next] < 0.0 || p*value[next - 1] < 0.0) where[found++] = x;
    }
    return found;
}
