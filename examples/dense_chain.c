/* The traditional method for CHAIN(n), as the foil of paper_chain.py: mass matrix, its direct differentiation, Cholesky.
 *
 * Eqs. 4-9 of Anderson and Hsu with the best of handwork: M and K of the ground's components about the ground's origin, rods
 * as bodies of revolution, K by a recursion, nothing stored that need not be, inner loops along contiguous arrays.
 * Two ways to M and dM/dp:
 *   COMPOSITE 1   from composite inertias, n^2/2 products of six numbers: the best a dense method can do;
 *   COMPOSITE 0   as the partial velocities of all bodies summed up, n^3/6 of them: the textbook.
 *
 * Rod k has the length l[k], mass l[k] (1 kg/m), radius 0.05 m; hinge axes y, x, y, ...; gravity (0, 0, -9.81).
 * Returns udot, the kinetic energy, and along each of `directions` seeds (dq, du, dl: [direction][n]) their total derivatives.
 * work: 2*n*n + 104*n doubles. Returns 0, or k if M is not positive definite at row k.
 */
#include "rods.h"

#ifndef COMPOSITE
#define COMPOSITE 1
#endif

/* A sum of products in eight parts, which a compiler may put in lanes. */
static double dot(const double *a, const double *b, int n)
{
    double part[8] = {0}, rest = 0;
    int i = 0;
    for (; i + 8 <= n; i += 8)
        for (int j = 0; j < 8; ++j) part[j] += a[i + j] * b[i + j];
    for (; i < n; ++i) rest += a[i] * b[i];
    return rest + ((part[0] + part[4]) + (part[1] + part[5])) + ((part[2] + part[6]) + (part[3] + part[7]));
}

/* Per body; the joint's partial velocities about the origin are (z, y), y = o x z. */
typedef struct {
    rod body;
    vector z, o, y, w, v, alpha, a, n, f;
} state;

#if COMPOSITE
/* row[r] = z_r . n + y_r . f for r <= k */
static inline void row_of(int k, const double *z, const double *y, int n, vector N, vector F, double *restrict row)
{
    for (int r = 0; r <= k; ++r)
        row[r] = z[r] * N.x + z[n + r] * N.y + z[2 * n + r] * N.z + y[r] * F.x + y[n + r] * F.y + y[2 * n + r] * F.z;
}
#endif

int dense(int n, int directions, const double *q, const double *u, const double *l, const double *dq, const double *du,
          const double *dl, double *udot, double *dudot, double *kinetic, double *dkinetic, double *work)
{
    double *M = work; /* by columns; M[k*n + r], r >= k, is factored in place */
    double *z = M + n * n, *y = z + 3 * n, *dz = y + 3 * n, *dy = dz + 3 * n;
    double *row = dy + 3 * n, *drow = row + n, *Mu = drow + n, *pivot = Mu + n, *rhs = pivot + n;
    double *arms = rhs + n, *dM = arms + 12 * n; /* for COMPOSITE 0 */
    state *s = (state *)(dM + n * n);
    (void)row;
    (void)drow;

    /* Outward. */
    vector X = {1, 0, 0}, Y = {0, 1, 0}, e = {0, 0, 1}, o = {0, 0, 0}, w = {0, 0, 0}, v = {0, 0, 0};
    vector alpha = {0, 0, 0}, a = {0, 0, GRAVITY};
    for (int k = 0; k < n; ++k) {
        state *b = s + k;
        const double c = cos(q[k]), si = sin(q[k]), L = l[k];
        if (k > 0) o = sub(o, mul(l[k - 1], e));
        if (k % 2 == 0) {
            const vector x = X;
            X = sub(mul(c, x), mul(si, e));
            e = add(mul(si, x), mul(c, e));
            b->z = Y;
        } else {
            const vector t = Y;
            Y = add(mul(c, t), mul(si, e));
            e = sub(mul(c, e), mul(si, t));
            b->z = X;
        }
        b->o = o;
        b->y = cross(o, b->z);
        b->body = (rod){e, sub(o, mul(L / 2, e)), L, L * (3 * RADIUS * RADIUS + L * L) / 12, L * RADIUS * RADIUS / 2};
        /* A_k = A_{k-1} + V_k x (z, y) u */
        w = add(w, mul(u[k], b->z));
        v = add(v, mul(u[k], b->y));
        alpha = add(alpha, mul(u[k], cross(w, b->z)));
        a = add(a, mul(u[k], add(cross(w, b->y), cross(v, b->z))));
        b->w = w; b->v = v; b->alpha = alpha; b->a = a;
        z[k] = b->z.x; z[n + k] = b->z.y; z[2 * n + k] = b->z.z;
        y[k] = b->y.x; y[n + k] = b->y.y; y[2 * n + k] = b->y.z;
    }

    /* Inward: bias forces, K, composite inertias. M by columns of the lower triangle. */
    inertia sum = {0};
    vector moment = {0, 0, 0}, force = {0, 0, 0};
    memset(M, 0, sizeof(double) * (size_t)n * (size_t)n);
    for (int k = n - 1; k >= 0; --k) {
        state *b = s + k;
        const inertia I = about_origin(&b->body);
        const vector P = angular(&I, b->w, b->v), Q = linear(&I, b->w, b->v);
        moment = add(moment, add(angular(&I, b->alpha, b->a), add(cross(b->w, P), cross(b->v, Q))));
        force = add(force, add(linear(&I, b->alpha, b->a), cross(b->w, Q)));
        rhs[k] = -dot3(b->z, moment) - dot3(b->y, force);
        accumulate(&sum, &I);
        b->n = angular(&sum, b->z, b->y);
        b->f = linear(&sum, b->z, b->y);
#if COMPOSITE
        row_of(k, z, y, n, b->n, b->f, row);
        for (int r = 0; r <= k; ++r) M[r * n + k] = row[r];
#else
        /* Partial velocities of body k's centre, and the angular ones times its inertia. */
        double *px = arms, *py = px + n, *pz = py + n, *ix = pz + n, *iy = ix + n, *iz = iy + n;
        const rod *B = &b->body;
        for (int r = 0; r <= k; ++r) {
            const vector p = cross(s[r].z, sub(B->c, s[r].o));
            const vector g = add(mul(B->a, s[r].z), mul((B->b - B->a) * dot3(B->e, s[r].z), B->e));
            px[r] = B->m * p.x; py[r] = B->m * p.y; pz[r] = B->m * p.z;
            ix[r] = g.x; iy[r] = g.y; iz[r] = g.z;
        }
        for (int r = 0; r <= k; ++r) {
            double *restrict column = M + r * n;
            const vector p = mul(1 / B->m, (vector){px[r], py[r], pz[r]}), g = s[r].z;
            for (int t = r; t <= k; ++t)
                column[t] += p.x * px[t] + p.y * py[t] + p.z * pz[t] + g.x * ix[t] + g.y * iy[t] + g.z * iz[t];
        }
#endif
    }

    /* Kinetic energy; Cholesky by columns; udot. */
    for (int k = 0; k < n; ++k) Mu[k] = 0;
    for (int k = 0; k < n; ++k) {
        const double *column = M + k * n;
        const double uk = u[k];
        Mu[k] += column[k] * uk + dot(column + k + 1, u + k + 1, n - k - 1);
        for (int r = k + 1; r < n; ++r) Mu[r] += column[r] * uk;
    }
    *kinetic = 0.5 * dot(Mu, u, n);
    for (int k = 0; k < n; ++k) {
        double *restrict column = M + k * n;
        for (int j = 0; j < k; ++j) {
            const double *left = M + j * n, factor = left[k];
            for (int r = k; r < n; ++r) column[r] -= factor * left[r];
        }
        if (!(column[k] > 0)) return k + 1;
        pivot[k] = 1 / sqrt(column[k]);
        for (int r = k; r < n; ++r) column[r] *= pivot[k];
    }
#define SOLVE(x)                                                                       \
    do {                                                                               \
        for (int k = 0; k < n; ++k) {                                                  \
            const double *column = M + k * n, xk = (x)[k] *= pivot[k];                 \
            for (int r = k + 1; r < n; ++r) (x)[r] -= column[r] * xk;                  \
        }                                                                              \
        for (int k = n - 1; k >= 0; --k)                                               \
            (x)[k] = ((x)[k] - dot(M + k * n + k + 1, (x) + k + 1, n - k - 1)) * pivot[k]; \
    } while (0)
    SOLVE(rhs);
    memcpy(udot, rhs, sizeof(double) * (size_t)n);

    /* Every direction: dK - dM udot, and the solution with M's factor (Eq. 9). A turn of body k is delta x. */
    for (int d = 0; d < directions; ++d, dq += n, du += n, dl += n, dudot += n) {
        double quadratic = 0;
        vector delta = {0, 0, 0}, dlast = {0, 0, 0}, doo = {0, 0, 0}, dw = {0, 0, 0}, dv = {0, 0, 0};
#if !COMPOSITE
        memset(dM, 0, sizeof(double) * (size_t)n * (size_t)n);
#endif
        vector dalpha = {0, 0, 0}, da = {0, 0, 0};
        state *t = s + n; /* tangents */
        for (int k = 0; k < n; ++k) {
            const state *b = s + k;
            state *g = t + k;
            if (k > 0) doo = sub(doo, add(mul(dl[k - 1], s[k - 1].body.e), mul(l[k - 1], dlast)));
            g->z = cross(delta, b->z);
            delta = add(delta, mul(dq[k], b->z));
            const vector E = b->body.e, de = cross(delta, E);
            const double L = l[k], dL = dl[k];
            dlast = de;
            g->o = doo;
            g->y = add(cross(doo, b->z), cross(b->o, g->z));
            g->body = (rod){de, sub(doo, add(mul(dL / 2, E), mul(L / 2, de))), dL,
                            dL * (RADIUS * RADIUS + L * L) / 4, dL * RADIUS * RADIUS / 2};
            dw = add(dw, add(mul(du[k], b->z), mul(u[k], g->z)));
            dv = add(dv, add(mul(du[k], b->y), mul(u[k], g->y)));
            dalpha = add(dalpha, add(mul(du[k], cross(b->w, b->z)), mul(u[k], add(cross(dw, b->z), cross(b->w, g->z)))));
            da = add(da, add(mul(du[k], add(cross(b->w, b->y), cross(b->v, b->z))),
                             mul(u[k], add(add(cross(dw, b->y), cross(b->w, g->y)), add(cross(dv, b->z), cross(b->v, g->z))))));
            g->w = dw; g->v = dv; g->alpha = dalpha; g->a = da;
            dz[k] = g->z.x; dz[n + k] = g->z.y; dz[2 * n + k] = g->z.z;
            dy[k] = g->y.x; dy[n + k] = g->y.y; dy[2 * n + k] = g->y.z;
            dudot[k] = 0;
        }
        inertia both = {0}, dboth = {0};
        vector dmoment = {0, 0, 0}, dforce = {0, 0, 0};
        moment = force = (vector){0, 0, 0};
        for (int k = n - 1; k >= 0; --k) {
            const state *b = s + k, *g = t + k;
            const inertia I = about_origin(&b->body), dI = about_origin_tangent(&b->body, &g->body);
            const vector P = angular(&I, b->w, b->v), Q = linear(&I, b->w, b->v);
            const vector dP = add(angular(&dI, b->w, b->v), angular(&I, g->w, g->v));
            const vector dQ = add(linear(&dI, b->w, b->v), linear(&I, g->w, g->v));
            moment = add(moment, add(angular(&I, b->alpha, b->a), add(cross(b->w, P), cross(b->v, Q))));
            force = add(force, add(linear(&I, b->alpha, b->a), cross(b->w, Q)));
            dmoment = add(dmoment, add(add(angular(&dI, b->alpha, b->a), angular(&I, g->alpha, g->a)),
                                       add(add(cross(g->w, P), cross(b->w, dP)), add(cross(g->v, Q), cross(b->v, dQ)))));
            dforce = add(dforce, add(add(linear(&dI, b->alpha, b->a), linear(&I, g->alpha, g->a)),
                                     add(cross(g->w, Q), cross(b->w, dQ))));
            dudot[k] -= dot3(g->z, moment) + dot3(b->z, dmoment) + dot3(g->y, force) + dot3(b->y, dforce);
            accumulate(&both, &I);
            accumulate(&dboth, &dI);
#if COMPOSITE
            /* Row k of dM, used at once: rhs -= dM udot, and u^T dM u. */
            const vector N = add(angular(&dboth, b->z, b->y), angular(&both, g->z, g->y));
            const vector F = add(linear(&dboth, b->z, b->y), linear(&both, g->z, g->y));
            row_of(k, z, y, n, N, F, drow);
            for (int r = 0; r <= k; ++r)
                drow[r] += dz[r] * b->n.x + dz[n + r] * b->n.y + dz[2 * n + r] * b->n.z
                         + dy[r] * b->f.x + dy[n + r] * b->f.y + dy[2 * n + r] * b->f.z;
            const double uk = udot[k];
            for (int r = 0; r < k; ++r) dudot[r] -= drow[r] * uk;
            dudot[k] -= dot(drow, udot, k + 1);
            quadratic += u[k] * (2 * dot(drow, u, k) + drow[k] * u[k]);
#else
            double *px = arms, *py = px + n, *pz = py + n, *ix = pz + n, *iy = ix + n, *iz = iy + n;
            double *qx = iz + n, *qy = qx + n, *qz = qy + n, *jx = qz + n, *jy = jx + n, *jz = jy + n;
            const rod *B = &b->body, *D = &g->body;
            const double spin = B->b - B->a, dspin = D->b - D->a;
            for (int r = 0; r <= k; ++r) {
                const vector arm = sub(B->c, s[r].o), darm = sub(D->c, t[r].o), Z = s[r].z, dZ = t[r].z;
                const vector p = cross(Z, arm), dp = add(cross(dZ, arm), cross(Z, darm));
                const double ez = dot3(B->e, Z), dez = dot3(D->e, Z) + dot3(B->e, dZ);
                const vector h = add(mul(B->a, Z), mul(spin * ez, B->e));
                const vector dh = add(add(mul(D->a, Z), mul(B->a, dZ)),
                                      add(mul(dspin * ez + spin * dez, B->e), mul(spin * ez, D->e)));
                px[r] = p.x; py[r] = p.y; pz[r] = p.z;
                qx[r] = dp.x; qy[r] = dp.y; qz[r] = dp.z;
                ix[r] = h.x; iy[r] = h.y; iz[r] = h.z;
                jx[r] = dh.x; jy[r] = dh.y; jz[r] = dh.z;
            }
            for (int r = 0; r <= k; ++r) {
                double *restrict column = dM + r * n;
                const vector p = {px[r], py[r], pz[r]}, Z = s[r].z, dZ = t[r].z;
                const vector dp = add(mul(D->m, p), mul(B->m, (vector){qx[r], qy[r], qz[r]})), mp = mul(B->m, p);
                for (int i = r; i <= k; ++i)
                    column[i] += mp.x * qx[i] + mp.y * qy[i] + mp.z * qz[i] + dp.x * px[i] + dp.y * py[i] + dp.z * pz[i]
                               + dZ.x * ix[i] + dZ.y * iy[i] + dZ.z * iz[i] + Z.x * jx[i] + Z.y * jy[i] + Z.z * jz[i];
            }
#endif
        }
#if !COMPOSITE
        for (int k = 0; k < n; ++k) {
            const double *column = dM + k * n, below = dot(column + k + 1, u + k + 1, n - k - 1);
            quadratic += u[k] * (column[k] * u[k] + 2 * below);
            dudot[k] -= dot(column + k, udot + k, n - k);
            for (int r = k + 1; r < n; ++r) dudot[r] -= column[r] * udot[k];
        }
#endif
        SOLVE(dudot);
        dkinetic[d] = dot(Mu, du, n) + 0.5 * quadratic;
    }
    return 0;
}
