/* Three callers share batches among four threads, now and then after a pause; results are those of one thread, bit by bit. */
#include "arm.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { STATES = 1003, THREADS = 4, ROUNDS = 60 };
static double q[STATES*ARM_NQ], u[STATES*ARM_NU], p[ARM_NP], inputs[ARM_NINPUTS + 1];

static void *call(void *result)
{
    const size_t size = sizeof(double)*STATES*ARM_NU;
    double *one = (double *)malloc(size), *shared = (double *)malloc(size);
    double *work = (double *)malloc(sizeof(double)*THREADS*ARM_STATES_WORKSPACE);
    int *codes = (int *)malloc(sizeof(int)*STATES);
    const struct timespec pause = {0, 1000000};
    for (int round = 0; round < ROUNDS; ++round) {
        arm_states b = {
            .count = STATES, .codes = codes, .q = {q, ARM_NQ, 1, 1}, .u = {u, ARM_NU, 1, 1}, .p = {p, 0, 1, 1},
            .inputs = {inputs, 0, 1, 1}, .udot = {one, ARM_NU, 1, 1}, .work = work,
        };
        const int expected = arm_accelerations_states(&b);
        const long failed = b.failed;
        b.udot.at = shared;
        if (round % 20 == 19) nanosleep(&pause, 0); /* threads sleep meanwhile */
        if (arm_on_threads(arm_accelerations_states, &b, THREADS) != expected || b.failed != failed
            || memcmp(one, shared, size)) *(int *)result = 1;
    }
    free(one), free(shared), free(work), free(codes);
    return 0;
}

int main(void)
{
    int different[3] = {0};
    pthread_t callers[3];
    for (int i = 0; i < STATES*ARM_NQ; ++i) q[i] = 0.001*(i % 977);
    for (int i = 0; i < STATES*ARM_NU; ++i) u[i] = 0.01*(i % 31);
    for (int i = 0; i < ARM_NP; ++i) p[i] = 0.3;
    for (int i = 0; i < 3; ++i) pthread_create(callers + i, 0, call, different + i);
    for (int i = 0; i < 3; ++i) pthread_join(callers[i], 0);
    puts(different[0] || different[1] || different[2] ? "different" : "same");
    return 0;
}
