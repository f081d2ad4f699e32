// What the page draws: solids and lines fixed in bodies, from the entry `display` of model.json at given parameters.
// It follows scene.py of the package; tests/live compares both.

const GROUND = -1;
const SAME = 1e-9; // points of a body that are closer than this, m, are one corner of its stick figure
const SLIDING = new Set(['prismatic', 'screw', 'cylindrical', 'planar']);
const OPERATIONS = {
  neg: (a) => -a, '+': (a, b) => a + b, '-': (a, b) => a - b, '*': (a, b) => a * b, '/': (a, b) => a / b, '**': Math.pow,
};
const modulo = (a, m) => a - m * Math.floor(a / m);
const OTHERS = { mod: modulo, wrapped: modulo, vanishing: (a, b) => a * b }; // functions that Math lacks

// The value of a number, or of an expression tree of parameters.
export function value(tree, known) {
  if (typeof tree === 'number') return tree;
  const [kind, ...of] = tree;
  if (kind === 'number') return of[0];
  if (kind === 'name') return known[of[0]];
  if (kind !== 'call') return OPERATIONS[kind](...of.map((x) => value(x, known)));
  const [name, ...given] = of;
  if (name === 'choice') return value(value(given[0], known) ? given[1] : given[2], known);
  const f = OTHERS[name] ?? Math[name];
  if (!f) throw new Error(`the display uses ${name}, which pages do not support`);
  return f(...given.map((x) => value(x, known)));
}

// The product of matrices [3][3].
const product = (a, b) => a.map((row) => [0, 1, 2].map((j) => row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j]));
const UNIT = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

// The matrix of a rotation about an axis (Rodrigues' formula).
function rotation(axis, angle) {
  const [x, y, z] = axis.map((a) => a / Math.hypot(...axis));
  const cross = [[0, -z, y], [z, 0, -x], [-y, x, 0]], square = product(cross, cross);
  return UNIT.map((row, i) => row.map((e, j) => e + Math.sin(angle) * cross[i][j] + (1 - Math.cos(angle)) * square[i][j]));
}

// A rotation that turns the z axis into an axis.
function fromZ(axis) {
  const [x, y, z] = axis.map((a) => a / Math.hypot(...axis)), sine = Math.hypot(x, y);
  if (sine < 1e-12) return z > 0 ? UNIT : [[1, 0, 0], [0, -1, 0], [0, 0, -1]];
  return rotation([-y, x, 0], Math.atan2(sine, z));
}

const same = (a, b) => a.every((x, i) => Math.abs(x - b[i]) <= SAME);
const distinct = (points) => points.filter((x, i) => !points.slice(0, i).some((y) => same(x, y)));

// The scene at parameters p: solids {body, type, sizes, rotation, at, color}; lines {bodies, ends} of sticks, rails and elements; points
// {body, at} of joints, loops and points.
export function sceneOf(model, p) {
  const known = Object.fromEntries(model.parameter_names.map((name, i) => [name, p[i]]));
  const place = (trees) => trees.map((x) => value(x, known));
  const { bodies, loops, points, elements } = model.display;
  const scene = { solids: [], sticks: [], rails: [], elements: [], joints: [], loops: [], points: [] };
  const corners = bodies.map(() => [[0, 0, 0]]);
  const add = (kind, { body, at }) => {
    scene[kind].push({ body, at });
    if (body !== GROUND) corners[body].push(at);
  };
  const solid = (body, given) => {
    let turn = UNIT;
    for (const [axis, angle] of given.rotation ?? []) turn = product(turn, rotation(place(axis), value(angle, known)));
    if (given.axis) turn = product(turn, fromZ(place(given.axis)));
    const { type, color = '' } = given;
    scene.solids.push({ body, type, sizes: place(given.sizes), rotation: turn, at: place(given.at), color });
  };
  bodies.forEach(({ parent, joint, visuals }, k) => {
    const at = place(joint.at);
    if (joint.type !== 'free') scene.joints.push({ body: parent, at });
    if (parent !== GROUND) corners[parent].push(at);
    if (SLIDING.has(joint.type)) scene.rails.push({ bodies: [parent, k], ends: [at, [0, 0, 0]] });
    for (const given of visuals ?? []) solid(k, given);
  });
  for (const given of model.display.visuals ?? []) solid(GROUND, given);
  const ends = elements.map((x) => x.ends.map((end) => ({ body: end.body, at: place(end.at) })));
  for (const of of ends) {
    if (of.length === 2) scene.elements.push({ bodies: of.map((x) => x.body), ends: of.map((x) => x.at) });
    for (const { body, at } of of) if (body !== GROUND) corners[body].push(at);
  }
  for (const loop of loops) for (const end of loop.ends) add('loops', { body: end.body, at: place(end.at) });
  for (const point of points) add('points', { body: point.body, at: place(point.at) });
  bodies.forEach((body, k) => {
    if (body.visuals) return;
    let found = distinct(corners[k]);
    if (found.length < 2) found = distinct([...found, place(body.com)]);
    for (const end of found.slice(1)) scene.sticks.push({ bodies: [k, k], ends: [found[0], end] });
  });
  return scene;
}
