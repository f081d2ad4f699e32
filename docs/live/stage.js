// The mechanism in three dimensions, drawn with three.js.

import {
  BoxGeometry, BufferAttribute, BufferGeometry, CapsuleGeometry, Color, CylinderGeometry, DirectionalLight, Group, HemisphereLight, Line,
  LineBasicMaterial, Matrix4, Mesh, MeshStandardMaterial, PerspectiveCamera, Scene, SphereGeometry, Vector3, WebGLRenderer,
} from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';

const COLORS = ['#4c78a8', '#f58518', '#54a24b', '#b279a2', '#e45756']; // of bodies without a colour, in turn
const colorOf = (body) => (body < 0 ? '#b8c0c8' : COLORS[body % COLORS.length]);
const LINES = { sticks: ['#5f6b7a', 0.012], rails: ['#9aa5b1', 0.005], elements: ['#e45756', 0.008] }; // radius per size of the scene
const MARKS = { joints: ['#30363d', 0.018], loops: ['#d62728', 0.02], points: ['#2ca02c', 0.014] };
const PARTS = [...Object.keys(LINES), ...Object.keys(MARKS)];

const cylinder = (radius, length) => new CylinderGeometry(radius, radius, length, 24).rotateX(Math.PI / 2);
const GEOMETRIES = {
  box: (s) => new BoxGeometry(...s),
  sphere: (s) => new SphereGeometry(s[0], 32, 16),
  ellipsoid: (s) => new SphereGeometry(1, 32, 16).scale(...s),
  capsule: (s) => new CapsuleGeometry(s[0], s[1], 8, 24).rotateX(Math.PI / 2),
  cylinder: (s) => cylinder(...s),
  rod: (s) => cylinder(0.02 * s[0], s[0]),
  mesh: (s) => new BoxGeometry(0.1, 0.1, 0.1), // pages contain no mesh files
};

export class Stage {
  constructor(canvas) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.camera = new PerspectiveCamera(32, 1, 0.01, 1000);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.scene = new Scene();
    this.sun = new DirectionalLight('#ffffff', 2.2);
    this.scene.add(this.sun, new HemisphereLight('#ffffff', '#889099', 1.6));
    this.parts = new Group();
    this.scene.add(this.parts);
  }

  // Looks at the whole motion, from a direction.
  frame(motion, scene, direction) {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity], x = new Vector3();
    const places = PARTS.flatMap((kind) => scene[kind].flatMap((part) => part.ends?.map((at, i) => ({ body: part.bodies[i], at })) ?? [part]));
    for (const { body, type, sizes, at } of scene.solids) {
      const geometry = GEOMETRIES[type](sizes);
      geometry.computeBoundingSphere();
      places.push({ body, at, radius: geometry.boundingSphere.radius });
    }
    for (let n = 0; n < motion.rows; n += Math.ceil(motion.rows / 60)) {
      for (const { body, at, radius = 0 } of places) {
        x.set(...at).applyMatrix4(this.body(motion, n, body));
        x.toArray().forEach((e, i) => { low[i] = Math.min(low[i], e - radius); high[i] = Math.max(high[i], e + radius); });
      }
    }
    this.size = Math.max(Math.hypot(...high.map((e, i) => e - low[i])), 1e-3);
    const centre = new Vector3(...high.map((e, i) => (e + low[i]) / 2)), from = new Vector3(...direction).normalize();
    this.camera.position.copy(centre).addScaledVector(from, 1.5 * this.size);
    this.camera.near = 0.01 * this.size;
    this.camera.far = 50 * this.size;
    this.controls.target.copy(centre);
    this.controls.update();
    this.sun.position.copy(from).add(new Vector3(0.6, 0.3, 1.2));
  }

  // The matrix of a body's frame at a row of results.
  body(motion, row, k) {
    const m = new Matrix4();
    if (k < 0) return m;
    const i = (row * motion.bodies + k) * 18, [a, b, c, d, e, f, g, h, j, x, y, z] = motion.frames.subarray(i, i + 12);
    return m.set(a, b, c, x, d, e, f, y, g, h, j, z, 0, 0, 0, 1);
  }

  // Replaces all parts by those of a scene. `show` places them.
  build(scene, motion) {
    for (const part of this.parts.children) {
      part.geometry.dispose();
      part.material.dispose();
    }
    this.parts.clear();
    const add = (geometry, color, more) => {
      const opacity = color.length > 7 ? parseInt(color.slice(7), 16) / 255 : 1;
      const look = { color: new Color(color.slice(0, 7)), roughness: 0.55, opacity, transparent: opacity < 1, depthWrite: opacity === 1 };
      const material = new MeshStandardMaterial(look);
      const mesh = new Mesh(geometry, material);
      mesh.matrixAutoUpdate = false;
      this.parts.add(Object.assign(mesh, { userData: more }));
    };
    for (const { body, type, sizes, rotation: r, at, color } of scene.solids) {
      const local = new Matrix4().set(...r[0], at[0], ...r[1], at[1], ...r[2], at[2], 0, 0, 0, 1);
      add(GEOMETRIES[type](sizes), color || colorOf(body), { body, local });
    }
    for (const [kind, [color, radius]] of Object.entries(LINES)) {
      for (const line of scene[kind]) {
        const shade = kind === 'sticks' ? colorOf(line.bodies[0]) : color;
        add(cylinder(radius * this.size, 1), shade, { line });
      }
    }
    for (const [kind, [color, radius]] of Object.entries(MARKS)) {
      for (const { body, at } of scene[kind]) {
        add(new SphereGeometry(radius * this.size, 16, 8), color, { body, local: new Matrix4().makeTranslation(...at) });
      }
    }
    for (const point of scene.points) if (point.body >= 0) this.parts.add(this.trail(point, motion));
  }

  // The path of a point over the motion.
  trail({ body, at }, motion) {
    const places = new Float32Array(3 * motion.rows), x = new Vector3();
    for (let n = 0; n < motion.rows; ++n) x.set(...at).applyMatrix4(this.body(motion, n, body)).toArray(places, 3 * n);
    const geometry = new BufferGeometry().setAttribute('position', new BufferAttribute(places, 3));
    return new Line(geometry, new LineBasicMaterial({ color: MARKS.points[0] }));
  }

  // Places all parts as at a row of results, and draws.
  show(motion, row) {
    const frames = new Map(), frame = (k) => frames.get(k) ?? frames.set(k, this.body(motion, row, k)).get(k);
    for (const part of this.parts.children) {
      const { line, body, local } = part.userData;
      if (line) {
        const [a, b] = line.ends.map((at, i) => new Vector3(...at).applyMatrix4(frame(line.bodies[i])));
        const length = Math.max(a.distanceTo(b), 1e-9);
        part.matrix.lookAt(b, a, Math.abs(b.z - a.z) < 0.9 * length ? new Vector3(0, 0, 1) : new Vector3(1, 0, 0));
        part.matrix.scale(new Vector3(1, 1, length)).setPosition(a.add(b).multiplyScalar(0.5));
      } else if (local) {
        part.matrix.multiplyMatrices(frame(body), local);
      }
    }
    const { clientWidth: w, clientHeight: h } = this.renderer.domElement;
    if (w !== this.width || h !== this.height) {
      Object.assign(this, { width: w, height: h });
      this.renderer.setSize(w, h, false);
      this.camera.aspect = w / h;
      this.camera.updateProjectionMatrix();
    }
    this.renderer.render(this.scene, this.camera);
  }
}
