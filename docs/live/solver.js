// A generated solver, compiled for WebAssembly: its functions on typed arrays, and motions with derivatives.
// It runs in browsers and in Node.js. build.py describes a model by names, sizes of arrays, and the module as text.

const ENDS = [ // reasons for the end of a motion, as motion.h numbers them
  'end', 'paused', 'memory is short', 'event', 'a joint or a loop is singular', 'a loop opens', 'the steps become too small',
  'rates are not finite', 'too many steps', 'near a pose where a loop loses rank', 'a loop is poorly conditioned',
  'dependent speeds are not determined', 'the motion slides along a switch', 'switches accumulate', 'a redundant condition opens',
];

// The bytes of text in base64 that is compressed with gzip.
async function decompressed(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
  return new Response(stream).arrayBuffer();
}

export class Solver {
  static async load(model) {
    const module = await WebAssembly.compile(await decompressed(model.module));
    // The integrator imports the clock, because a caller may make it pause after some seconds. The page never does.
    const imports = { wasi_snapshot_preview1: { clock_time_get: () => 0 } };
    return new Solver(model, (await WebAssembly.instantiate(module, imports)).exports);
  }

  constructor(model, exports) {
    Object.assign(this, { model, exports });
    exports._initialize?.();
    this.nq = model.coordinate_names.length;
    this.nu = model.speed_names.length;
    this.np = model.parameter_names.length;
    this.noutputs = model.output_names.length;
    this.nframes = model.bodies.length * 18;
    this.nsignals = model.signals;
  }

  // A view of memory; it is valid until memory grows, so it is made anew for each use.
  view(address, length) {
    return new Float64Array(this.exports.memory.buffer, address, length);
  }

  // The array of an argument or result of the generated functions, such as 'q' or 'dudot'.
  array(name) {
    return this.view(this.exports[`at_${name}`].value, this.model.sizes[name]);
  }

  // Calls a generated function on these arrays; returns 0, or the number of the zero pivot.
  run(name) {
    return this.exports[`run_${name}`]();
  }

  // The motion at parameters p and constant inputs, for `time` seconds with results at `count` equal intervals, and its derivatives
  // with respect to variables {of: 'p' or 'inputs', at: index}. Steps are adaptive, unless `step` is given, s. Throws an Error if no motion
  // starts from this design.
  simulate({ p, inputs = [], time, count, along = [], tolerance = 1e-9, step = 0 }) {
    const { exports, nq, nu, noutputs, nframes } = this, k = along.length;
    this.array('p').set(p);
    this.array('inputs').fill(0).set(inputs);
    const seeds = { p: this.np, inputs: this.nsignals };
    for (const [of, n] of Object.entries(seeds)) {
      const rows = this.view(exports[`along_${of}`].value, k * n).fill(0);
      along.forEach((v, row) => { if (v.of === of) rows[row * n + v.at] = 1; });
    }
    const status = exports.live_start(k);
    if (status === 1) throw new Error('the loops do not close in this design');
    if (status === 2) throw new Error('a loop has lost rank in the initial state');
    const reason = exports.live_motion(time, count, k, tolerance, step);
    if (reason < 0) throw new Error('memory is short');
    const [rows, reached, accepted, rejected, evaluations, flat, rounded, touched] = this.view(exports.live_report.value, 8);
    const states = 1 + nq + nu, values = states + noutputs, size = values + k * (nq + nu + noutputs);
    const found = this.view(exports.live_rows(), rows * size);
    return {
      rows, reached, accepted, rejected, evaluations,
      end: reason === 0 ? '' : ENDS[reason],
      doubtful: flat < reached ? flat : Infinity, // derivatives may not exist after this time
      rounded: rounded !== 0, touched: touched !== 0,
      t: (n) => found[n * size],
      q: (n, i) => found[n * size + 1 + i],
      u: (n, i) => found[n * size + 1 + nq + i],
      output: (n, i) => found[n * size + states + i],
      derivative: (n, i, d) => found[n * size + values + k * (nq + nu) + d * noutputs + i],
      frames: this.view(exports.live_frames(), rows * nframes),
    };
  }
}
