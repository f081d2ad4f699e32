"""What an explicit integrator adds to the accelerations it asks for: CHAIN(8), 16 states, 5 s at 1e-9.

    python benchmarks/stepper.py [--instructions avx2] [--rounds 400]

A motion in C, and as many calls of what it calls, `state_rates`, at its initial state: they take turns in one program, least and
median times count. The difference over the number of calls is what a stage costs beside its accelerations: the sums of stages,
errors, sizes of steps, and that the next state is another one.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import tempfile
from pathlib import Path

import codegen
from codegen.measure.compiled import add_options, workshop
from codegen.measure.models import text_of
from codegen.measure.tables import markdown

RODS = 8
CLAIM = 0.25
"""us a stage."""

PROGRAM = """
#include "chain.h"
#include "chain_model.h"
#include "motion/motion.h"
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

extern const ordernm_system chain_system;

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9*t.tv_nsec;
}

int main(int count, char **words)
{
    const int rounds = count > 1 ? atoi(words[1]) : 100;
    const ordernm_system *const s = &chain_system;
    const double times[] = {0.0, 5.0}, inputs[CHAIN_NINPUTS + 1] = {0.0};
    double atol[CHAIN_NQ + CHAIN_NU];
    for (int i = 0; i < CHAIN_NQ + CHAIN_NU; ++i) atol[i] = 1e-9;
    const ordernm_problem problem = {
        .system = s, .method = ORDERNM_DOP853, .p = CHAIN_PARAMETERS, .q = CHAIN_INITIAL_Q, .u = CHAIN_INITIAL_U,
        .inputs = {.count = 1, .values = inputs}, .start = 0.0, .end = 5.0, .ntimes = 2, .times = times, .rtol = 1e-9,
        .atol = atol,
    };
    double *const rows = malloc(2*ordernm_row_size(&problem)*sizeof(double));
    double *const room = aligned_alloc(64, (ordernm_room(&problem)*sizeof(double) + 63)/64*64);
    double *const work = aligned_alloc(64, (s->workspace*sizeof(double) + 63)/64*64);
    double qdot[CHAIN_NQ], udot[CHAIN_NU], own_q[CHAIN_NQ], own_u[CHAIN_NU];
    for (int i = 0; i < CHAIN_NQ; ++i) own_q[i] = CHAIN_INITIAL_Q[i], own_u[i] = CHAIN_INITIAL_U[i];
    const ordernm_call call = {.q = own_q, .u = own_u, .p = CHAIN_PARAMETERS, .inputs = inputs, .qdot = qdot, .udot = udot,
        .work = work};
    for (int round = 0; round < rounds; ++round) {
        ordernm_results r = {.rows = rows, .capacity = 2};
        const double begin = now();
        ordernm_motion *const motion = ordernm_begin(&problem, room);
        while (ordernm_go(motion, &r, 1.0) == ORDERNM_PAUSED) continue;
        const double between = now();
        for (long i = 0; i < r.evaluations; ++i) s->state_rates(&call);
        printf("%ld %.9g %.9g\\n", (long)r.evaluations, between - begin, now() - between);
    }
    return 0;
}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, 400)
    options = parser.parse_args()
    shop = workshop(options)
    with tempfile.TemporaryDirectory() as name:
        folder, program = Path(name) / "chain", Path(name) / "stepper"
        codegen.generate(codegen.parse_model(text_of("CHAIN", RODS)), folder, functions=("motion",))
        (folder / "stepper.c").write_text(PROGRAM, encoding="utf-8")
        sources = [
            *(folder / f for f in ("stepper.c", "chain.c", "chain_motion.c")),
            *sorted((folder / "motion").glob("*.c")),
        ]
        command = [*shop.compiler, "-O2", *shop.all_flags, f"-I{folder}", *sources, "-lm", "-o", program]
        subprocess.run(command, check=True)
        lines = subprocess.run([program, str(options.rounds)], check=True, capture_output=True, text=True).stdout
    rows = [[float(x) for x in line.split()] for line in lines.splitlines()]
    calls = int(rows[0][0])
    motion, alone = ([1e6 * row[i] / calls for row in rows] for i in (1, 2))
    cells = [
        [what, *(f"{x:.3f}" for x in (of(motion), of(alone), of(motion) - of(alone)))]
        for what, of in (("least", min), ("median", statistics.median))
    ]
    print(f"CHAIN({RODS}), 5 s at 1e-9, {calls} calls; {shop.widest}, gcc -O2; claim: {CLAIM:g} us a stage\n")
    print(markdown(["us a stage", "motion", "accelerations alone", "difference"], cells))


if __name__ == "__main__":
    main()
