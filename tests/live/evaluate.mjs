// Evaluates functions and motions of pages: reads jobs as JSON from standard input, writes results as JSON.

import { readFileSync } from 'node:fs';

const { live, model, calls = [], motions = [], scenes = [] } = JSON.parse(readFileSync(0, 'utf8'));
const { Solver } = await import(`${live}/solver.js`);
const { sceneOf } = await import(`${live}/scene.js`);
const solver = model.module && (await Solver.load(model));

const called = calls.map(({ name, given, wanted }) => {
  for (const [array, numbers] of Object.entries(given)) solver.array(array).set(numbers);
  const status = solver.run(name);
  return { status, ...Object.fromEntries(wanted.map((array) => [array, Array.from(solver.array(array))])) };
});

const moved = motions.map((given) => {
  try {
    const { rows, end, evaluations, accepted, rejected, frames, ...motion } = solver.simulate(given);
    const each = (f, n) => Array.from({ length: rows }, (_, r) => Array.from({ length: n }, (_, i) => f(r, i)));
    return {
      rows, end, evaluations, accepted, rejected, frames: Array.from(frames), t: each(motion.t, 1), q: each(motion.q, solver.nq),
      outputs: each(motion.output, solver.noutputs),
      doutputs: given.along.map((_, d) => each((r, i) => motion.derivative(r, i, d), solver.noutputs)),
    };
  } catch (error) {
    return { error: error.message };
  }
});

process.stdout.write(JSON.stringify({ calls: called, motions: moved, scenes: scenes.map((p) => sceneOf(model, p)) }));
