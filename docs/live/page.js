// The page: sliders of a design; at each change the motion and its gradient are computed anew, drawn and plotted.

import { plot, timeAt } from './plot.js';
import { sceneOf } from './scene.js';
import { Solver } from './solver.js';
import { Stage } from './stage.js';

const RATE = 60, LEAST = 300, MOST = 600; // results per second of a motion; bounds of their number
const get = (id) => document.getElementById(id);
const models = JSON.parse(get('models').textContent);
const short = (x) => (x === 0 ? '0' : Math.abs(x) < 1e-3 || Math.abs(x) >= 1e5 ? x.toExponential(2) : String(Number(x.toPrecision(4))));

let stage = null;
try {
  stage = new Stage(get('stage'));
} catch {
  get('text').textContent = 'This browser has no WebGL, so the mechanism is not drawn.';
}

// What the page shows; tests read it as `live`.
const live = {
  solver: null, motion: null, first: null, milliseconds: 0, values: [], active: 0, output: 0, time: 0, playing: true, changed: false,
};
window.live = live;
const solvers = new Map();

// The motion of the present design and the milliseconds that it took, or the reason why there is none.
function compute() {
  const { model } = live.solver, p = [...model.parameters], inputs = new Array(model.signals).fill(0);
  model.sliders.forEach((s, k) => { (s.of === 'p' ? p : inputs)[s.at] = live.values[k]; });
  const count = Math.min(Math.max(Math.ceil(RATE * model.time), LEAST), MOST), began = performance.now();
  try {
    const found = live.solver.simulate({ p, inputs, time: model.time, count, along: model.sliders });
    live.milliseconds = performance.now() - began;
    return copied({ ...found, p, bodies: model.bodies.length });
  } catch (error) {
    if (error instanceof WebAssembly.RuntimeError) throw error;
    get('note').textContent = `${error.message}; the last motion is shown`;
    return null;
  }
}

// A motion in memory of its own: the next motion replaces that of the solver.
function copied(motion) {
  const { model } = live.solver, k = model.sliders.length, no = model.output_names.length;
  const t = Float64Array.from({ length: motion.rows }, (_, n) => motion.t(n));
  const outputs = Float64Array.from({ length: motion.rows * no }, (_, i) => motion.output(Math.floor(i / no), i % no));
  const slopes = Float64Array.from({ length: motion.rows * no * k }, (_, i) => {
    const n = Math.floor(i / (no * k));
    return t[n] > motion.doubtful ? NaN : motion.derivative(n, i % no, Math.floor(i / no) % k);
  });
  return {
    ...motion, frames: motion.frames.slice(), t: (n) => t[n], output: (n, i) => outputs[n * no + i],
    derivative: (n, i, d) => slopes[(n * k + d) * no + i],
  };
}

function update() {
  live.changed = false;
  get('note').textContent = '';
  const motion = compute();
  if (!motion) return;
  live.motion = motion;
  live.first ??= motion;
  const notes = [];
  if (motion.end) notes.push(`the motion ends at ${short(motion.reached)} s: ${motion.end}`);
  if (motion.doubtful < Infinity) notes.push(`a loop loses rank at ${short(motion.doubtful)} s; derivatives may not exist after it`);
  if (motion.touched) notes.push('a force only touches a switch: derivatives may not exist after it');
  if (motion.rounded) notes.push('near a loop without full rank, rounding errors are larger');
  get('note').textContent = notes.join('; ');
  const { accepted, rejected } = motion, directions = live.solver.model.sliders.length;
  get('cost').innerHTML = `motion and gradient with respect to ${directions} variables: <b>${live.milliseconds.toFixed(1)} ms</b> `
    + `(${accepted + rejected} steps, in this browser, in WebAssembly)`;
  if (stage) {
    const scene = sceneOf(live.solver.model, motion.p);
    if (live.first === motion) stage.frame(motion, scene, live.solver.model.camera);
    stage.build(scene, motion);
  }
}

// The row of results at the time of the cursor.
function row() {
  const { motion, time } = live, last = motion.rows - 1;
  return Math.min(Math.round(time / (motion.t(last) || 1) * last), last);
}

function draw() {
  const { motion, first, solver: { model }, output, active } = live;
  if (!motion || motion.rows < 1) return;
  const n = row(), slider = model.sliders[active], unit = model.output_units[output], name = model.output_names[output];
  stage?.show(motion, n);
  const changes = model.sliders.map((s, k) => live.values[k] - s.value), changed = changes.some(Boolean);
  const predicted = (i) => changes.reduce((sum, d, k) => sum + (d ? d * first.derivative(i, output, k) : 0), first.output(i, output));
  plot(get('plot'), {
    n: motion.rows, t: motion.t, end: model.time, now: motion.t(n),
    graphs: [
      { title: `${name}${unit && `, ${unit}`}   (grey: first design; dashed: predicted by its gradient)`, curves: [
        { at: (i) => (i < first.rows ? first.output(i, output) : NaN), color: '--quiet', width: 1 },
        { at: (i) => (i < first.rows && changed ? predicted(i) : NaN), color: '--quiet', dash: [4, 4], width: 1, ranged: false },
        { at: (i) => motion.output(i, output), color: '--value' },
      ] },
      { title: `derivative of ${name} with respect to ${slider.name}`, curves: [
        { at: (i) => motion.derivative(i, output, active), color: '--slope' },
      ] },
    ],
  });
  const slopes = model.sliders.map((_, k) => motion.derivative(n, output, k));
  const effects = slopes.map((s, k) => s * (model.sliders[k].max - model.sliders[k].min)); // of the whole slider, to first order
  const largest = Math.max(...effects.map(Math.abs), 1e-300);
  document.querySelectorAll('.slider').forEach((box, k) => {
    box.classList.toggle('active', k === active);
    box.querySelector('.gradient span').textContent = `derivative ${short(slopes[k])}`;
    const part = 50 * effects[k] / largest || 0;
    box.querySelector('i').style.cssText = `left: ${50 + Math.min(part, 0)}%; width: ${Math.abs(part)}%`;
  });
}

function buildSliders(model) {
  get('sliders').replaceChildren(...model.sliders.map((s, k) => {
    const box = document.createElement('div');
    box.className = 'slider';
    box.innerHTML = '<b></b><output></output><input type="range"><div class="gradient"><span></span><div><i></i></div></div>';
    const [name, shown, input] = box.children;
    name.textContent = s.name;
    const write = () => { shown.textContent = `${short(live.values[k])} ${s.unit}`; };
    Object.assign(input, { min: s.min, max: s.max, step: (s.max - s.min) / 1000, value: s.value });
    input.setAttribute('aria-label', s.name);
    input.addEventListener('input', () => {
      live.values[k] = Number(input.value);
      live.active = k;
      live.changed = true;
      write();
    });
    box.addEventListener('pointerdown', () => { live.active = k; });
    write();
    return box;
  }));
}

async function choose(model) {
  if (!solvers.has(model)) solvers.set(model, await Solver.load(model));
  Object.assign(live, {
    solver: solvers.get(model), values: model.sliders.map((s) => s.value), first: null, motion: null, active: 0, time: 0,
    output: model.output,
  });
  get('output').replaceChildren(...model.output_names.map((name, i) => new Option(name, i, false, i === model.output)));
  if (stage) get('text').textContent = model.text;
  document.querySelectorAll('#choice button').forEach((b, k) => b.setAttribute('aria-pressed', models[k] === model));
  buildSliders(model);
  update();
}

get('choice').replaceChildren(...models.map((model) => {
  const button = document.createElement('button');
  button.textContent = model.title;
  button.addEventListener('click', () => { location.hash = model.name; });
  return button;
}));
const chosen = () => models.find((m) => `#${m.name}` === location.hash) ?? models[0];
window.addEventListener('hashchange', () => choose(chosen()));
get('output').addEventListener('change', (event) => { live.output = Number(event.target.value); });
get('reset').addEventListener('click', () => choose(live.solver.model));
get('play').addEventListener('click', () => { live.playing = !live.playing; get('play').textContent = live.playing ? 'pause' : 'play'; });
const seek = (event) => {
  if (!event.buttons) return;
  live.playing = false;
  get('play').textContent = 'play';
  live.time = timeAt(get('plot'), event, live.solver.model.time);
};
get('plot').addEventListener('pointerdown', seek);
get('plot').addEventListener('pointermove', seek);

let before = 0;
function tick(now) {
  if (live.playing && live.motion) live.time = (live.time + Math.min(now - before, 100) / 1000) % (live.motion.reached || 1);
  before = now;
  if (live.changed) update();
  draw();
  requestAnimationFrame(tick);
}
await choose(chosen());
requestAnimationFrame(tick);
