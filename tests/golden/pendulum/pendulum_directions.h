/* Sweeps and functions over WIDTH directions at once. Included by pendulum.c once for every width. */

/* Values of a link per direction. */
typedef struct {
    LANES moment_y; /* moment about the origin and force that a link's motion with udot = 0 requires, [N m, N] */
    LANES right_side_0; /* driving force of a degree of freedom over its inertia (Eq. 53), u/s^2 */
} DIRECTIONS(ALIASES) DIRECTIONS(link_lanes);

/* Arguments and memory of one call over directions. */
typedef struct {
    double *udot;
    link_record *records;
    double *near;
    double *gravity;
    double *constants;
    double *trig;
    LANES *dq;
    LANES *du;
    LANES *dp;
    LANES *dudot;
    DIRECTIONS(link_lanes) *lanes;
    LANES *dtau;
    status singular;
    MORE_OF_A_CALL
} DIRECTIONS(call);

#if ((WIDTH == 8) && (ORDERNM_HAS(1, 2))) || ((WIDTH == 2) && (ORDERNM_HAS(11, 2))) || ((WIDTH == 1) && \
    (ORDERNM_HAS(11, 1)))
/* balance, outward: tangent of the inverse dynamics at fixed udot (Eqs. 25-29); rod
 * in: trig; up: total_acceleration; udot; c: first_moment, inertia; dq; dp
 * out: lane: moment
 * operations: 1 addition, 4 multiplications; 1 addition, 3 multiplications per direction */
static void DIRECTIONS(balance_out_0)(DIRECTIONS(call) *a)
{
    const constants_of_shape_0 *restrict c = (constants_of_shape_0 *)(a->constants + 0);
    EACH_VECTOR {
        const double up_ta_z = a->near[NEAR_SIZE*0 + BALANCE_OUT_TOTAL_ACCELERATION_Z];
        const double ap_z = a->trig[COSINE]*up_ta_z; /* Eq. 21 */
        const double ap_x = -a->trig[SINE]*up_ta_z;
        const VECTOR dq_rod = a->dq[0].at[h];
        const VECTOR d_ap_x = -ap_z*dq_rod; /* d Eq. 21 */
        const double udot_rod = a->udot[0];
        const double d_4 = ap_x*c->first_moment_z_d0 + c->inertia_xx_d0*udot_rod; /* primitive */
        const VECTOR dp_length = a->dp[0].at[h];
        const VECTOR d_n_y = c->first_moment_z*d_ap_x + d_4*dp_length; /* d Eq. 24 */
        a->lanes[0].moment_y.at[h] = d_n_y;
    }
}

/* balance, outward: tangent of the inverse dynamics at fixed udot (Eqs. 25-29) */
static void DIRECTIONS(balance_out)(DIRECTIONS(call) *a)
{
    a->near[BALANCE_OUT_TOTAL_ACCELERATION_Z] = a->gravity[2];
    DIRECTIONS(balance_out_0)(a);
}

/* balance, inward: transmitted forces and bias forces of the solution (Eqs. 9, 45, 50); rod
 * in: lane: moment; dtau; me: inverse_pivot_0
 * out: lane: right_side_0
 * operations: 1 addition, 1 multiplication per direction */
static void DIRECTIONS(balance_in_0)(DIRECTIONS(call) *a)
{
    DIRECTIONS(link_lanes) *restrict lane = &a->lanes[0];
    EACH_VECTOR {
        const VECTOR dtau_rod = a->dtau[0].at[h];
        const VECTOR r = dtau_rod - lane->moment_y.at[h]; /* d Eq. 53 */
        const VECTOR rD = a->records[0].inverse_pivot_0*r;
        lane->right_side_0.at[h] = rD;
    }
}

/* balance, inward: transmitted forces and bias forces of the solution (Eqs. 9, 45, 50) */
static void DIRECTIONS(balance_in)(DIRECTIONS(call) *a)
{
    DIRECTIONS(balance_in_0)(a);
}

/* balance, back substitution (Eqs. 53-55); rod
 * in: lane: right_side_0. out: dudot. operations: none */
static void DIRECTIONS(balance_back_0)(DIRECTIONS(call) *a)
{
    EACH_VECTOR {
        a->dudot[0].at[h] = a->lanes[0].right_side_0.at[h];
    }
}

/* balance, back substitution (Eqs. 53-55) */
static void DIRECTIONS(balance_back)(DIRECTIONS(call) *a)
{
    DIRECTIONS(balance_back_0)(a);
}

/* tangent of forces.friction.value of the model
 * in: du. out: dtau. operations: 1 multiplication per direction */
static void DIRECTIONS(joint_forces_tangents)(DIRECTIONS(call) *a)
{
    EACH_VECTOR {
        const VECTOR du_rod = a->du[0].at[h];
        const VECTOR d_tau = -0.01*du_rod;
        a->dtau[0].at[h] = d_tau;
    }
}
#endif

#if WIDTH == 8 || WIDTH == 1
#if ((WIDTH == 8) && (ORDERNM_HAS(7, 2))) || ((WIDTH == 1) && (ORDERNM_HAS(7, 1)))
/* transpose of balance, back substitution (Eqs. 53-55); rod
 * in: dudot. out: lane: right_side_0. operations: none */
static void DIRECTIONS(balance_back_transposed_0)(DIRECTIONS(call) *a)
{
    EACH_VECTOR {
        const VECTOR dudot_rod = a->dudot[0].at[h];
        a->lanes[0].right_side_0.at[h] = dudot_rod;
    }
}

/* transpose of balance, back substitution (Eqs. 53-55) */
static void DIRECTIONS(balance_back_transposed)(DIRECTIONS(call) *a)
{
    DIRECTIONS(balance_back_transposed_0)(a);
}

/* accelerations and weights of forces, outward; rod
 * in: me: inverse_pivot_0; lane: right_side_0
 * out: lane: moment; dtau
 * operations: 1 addition, 1 multiplication per direction */
static void DIRECTIONS(gradient_out_0)(DIRECTIONS(call) *a)
{
    DIRECTIONS(link_lanes) *restrict lane = &a->lanes[0];
    EACH_VECTOR {
        const VECTOR r_bar = lane->right_side_0.at[h]*a->records[0].inverse_pivot_0; /* T d Eq. 53 */
        lane->moment_y.at[h] = -r_bar;
        a->dtau[0].at[h] += r_bar;
    }
}

/* accelerations and weights of forces, outward */
static void DIRECTIONS(gradient_out)(DIRECTIONS(call) *a)
{
    DIRECTIONS(gradient_out_0)(a);
}

/* transmitted forces, and gradients of weighted accelerations, inward; rod
 * in: trig; up: total_acceleration; udot; c: first_moment, inertia; lane: moment
 * out: dq; dp; du
 * operations: 1 addition, 4 multiplications; 1 addition, 3 multiplications per direction */
static void DIRECTIONS(gradient_in_0)(DIRECTIONS(call) *a)
{
    const constants_of_shape_0 *restrict c = (constants_of_shape_0 *)(a->constants + 0);
    EACH_VECTOR {
        const double up_ta_z = a->records[1].total_acceleration_z;
        const double ap_z = a->trig[COSINE]*up_ta_z; /* Eq. 21 */
        const VECTOR lane_n_y = a->lanes[0].moment_y.at[h];
        const VECTOR d_ap_x_bar = c->first_moment_z*lane_n_y; /* T d Eq. 21 */
        const VECTOR dq_0_bar = -ap_z*d_ap_x_bar;
        const double ap_x = -a->trig[SINE]*up_ta_z; /* Eq. 21 */
        const double udot_rod = a->udot[0];
        const double d_4 = ap_x*c->first_moment_z_d0 + c->inertia_xx_d0*udot_rod; /* primitive */
        const VECTOR dp_0_bar = d_4*lane_n_y;
        a->dq[0].at[h] = dq_0_bar;
        a->dp[0].at[h] += dp_0_bar;
        a->du[0].at[h] = (VECTOR){0};
    }
}

/* transmitted forces, and gradients of weighted accelerations, inward */
static void DIRECTIONS(gradient_in)(DIRECTIONS(call) *a)
{
    DIRECTIONS(gradient_in_0)(a);
}

/* transpose of the tangent of forces.friction.value of the model
 * in: dtau. out: du. operations: 1 addition, 1 multiplication per direction */
static void DIRECTIONS(joint_forces_transposed)(DIRECTIONS(call) *a)
{
    EACH_VECTOR {
        const VECTOR dtau_rod = a->dtau[0].at[h];
        const VECTOR du_0_bar = -0.01*dtau_rod;
        a->du[0].at[h] += du_0_bar;
    }
}
#endif

#endif
/* Begins the part of a call that runs over directions. */
static void DIRECTIONS(open)(DIRECTIONS(call) *d, const call *c, double *work)
{
    work = aligned(work);
    d->udot = c->udot;
    d->records = c->records;
    d->near = c->near;
    d->gravity = c->gravity;
    d->constants = c->constants;
    d->trig = c->trig;
    d->lanes = (DIRECTIONS(link_lanes) *)(work + 72);
    d->dtau = (LANES *)(work + 88);
    d->singular = (status){0};
}

#if ((WIDTH == 8) && (ORDERNM_HAS(1, 2))) || ((WIDTH == 2) && (ORDERNM_HAS(11, 2))) || ((WIDTH == 1) && \
    (ORDERNM_HAS(11, 1)))
/* Computes dudot from the seeds, with the factors and accelerations of the forward dynamics. */
static void DIRECTIONS(balance)(DIRECTIONS(call) *a)
{
    DIRECTIONS(joint_forces_tangents)(a);
    DIRECTIONS(balance_out)(a);
    DIRECTIONS(balance_in)(a);
    DIRECTIONS(balance_back)(a);
}
#endif

#if WIDTH == 8 || WIDTH == 1
#if ((WIDTH == 8) && (ORDERNM_HAS(7, 2))) || ((WIDTH == 1) && (ORDERNM_HAS(7, 1)))
/* Transposed steps of sensitivities, in reverse order. */
static void DIRECTIONS(sensitivities_backwards)(DIRECTIONS(call) *a)
{
    for (long i = 0; i < 1L; ++i) a->dtau[i] = NOTHING;
    for (int i = 0; i < 1; ++i) a->dp[i] = NOTHING;
    DIRECTIONS(balance_back_transposed)(a);
    DIRECTIONS(gradient_out)(a);
    DIRECTIONS(gradient_in)(a);
    DIRECTIONS(joint_forces_transposed)(a);
}
#endif

#endif
#ifndef ORDERNM_STATES
#if ((WIDTH == 8) && (ORDERNM_HAS(1, 2))) || ((WIDTH == 2) && (ORDERNM_HAS(11, 2))) || ((WIDTH == 1) && (ORDERNM_HAS(11, 1)))
/* Forward dynamics and its total derivative along seeds (Eqs. 9, 10, by the balance). */
int DIRECTIONS(pendulum_sensitivities)(const double *q, const double *u, const double *p, const double *dq,
    const double *du, const double *dp, double *udot, double *dudot, double *work)
{
    call c;
    c.q = q, c.u = u, c.p = p, c.udot = udot;
    DIRECTIONS(call) d;
    lay_out(&c, work);
    start(&c);
    if (forward(&c)) return c.singular;
    DIRECTIONS(open)(&d, &c, work);
    d.dq = (LANES *)dq;
    d.du = (LANES *)du;
    d.dp = (LANES *)dp;
    d.dudot = (LANES *)dudot;
    DIRECTIONS(balance)(&d);
    return 0;
}
#endif

#if WIDTH == 8 || WIDTH == 1
#if ((WIDTH == 8) && (ORDERNM_HAS(7, 2))) || ((WIDTH == 1) && (ORDERNM_HAS(7, 1)))
/* Forward dynamics (Eqs. 18-24, 42-56), and gradients of their weighted sums (transpose of sensitivities). */
int DIRECTIONS(pendulum_sensitivities_transposed)(const double *q, const double *u, const double *p,
    const double *dudot, double *udot, double *dq, double *du, double *dp, double *work)
{
    call c;
    c.q = q, c.u = u, c.p = p, c.udot = udot;
    DIRECTIONS(call) d;
    lay_out(&c, work);
    start(&c);
    if (forward(&c)) return c.singular;
    DIRECTIONS(open)(&d, &c, work);
    d.dudot = (LANES *)dudot;
    d.dq = (LANES *)dq;
    d.du = (LANES *)du;
    d.dp = (LANES *)dp;
    DIRECTIONS(sensitivities_backwards)(&d);
    return 0;
}
#endif

#endif
#endif
