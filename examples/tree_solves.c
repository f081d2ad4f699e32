/* What constrained_chain.c needs of the generated solver of a tree: its own sweeps, with the factors of M kept between calls.
 *
 * The functions of a generated header factor M anew in every call. Here it is factored once, and eight right-hand sides are
 * solved for in one pass, as the generated code does it with directions. `tree.inc` is the generated file.
 */
#include "tree.inc"

static call kept;

/* Kinematics, triangularization and udot of the tree. */
int tree_forward(const double *q, const double *u, const double *p, double *udot, double *work)
{
    kept = (call){0};
    lay_out(&kept, work);
    kept.q = q;
    kept.u = (double *)u; /* which nothing writes into */
    kept.p = p;
    kept.udot = udot;
    start(&kept);
    return forward(&kept);
}

/* x = M^-1 b for eight columns side by side, and for one. */
void tree_solve_8(const double *b, double *x, double *work)
{
    call_8 d;
    open_8(&d, &kept, work);
    d.b = (lanes_8 *)b;
    d.dudot = (lanes_8 *)x;
    solve_in_8(&d);
    balance_back_8(&d);
}

void tree_solve_1(const double *b, double *x, double *work)
{
    call_1 d;
    open_1(&d, &kept, work);
    d.b = (lanes_1 *)b;
    d.dudot = (lanes_1 *)x;
    solve_in_1(&d);
    balance_back_1(&d);
}

/* d(M udot - K) along dq, du, dp at fixed udot. */
void tree_force_tangent(double *udot, const double *dq, const double *du, const double *dp, double *force, double *dforce,
                        double *work)
{
    call_1 d;
    open_1(&d, &kept, work);
    d.dq = (lanes_1 *)dq;
    d.du = (lanes_1 *)du;
    d.dp = (lanes_1 *)dp;
    d.udot = udot;
    d.force = force;
    d.dforce = (lanes_1 *)dforce;
    mass_tangent_1(&d);
}
