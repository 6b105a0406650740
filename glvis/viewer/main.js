// The page's state, and what happens when it changes. `window.glvis` is for tests and scripts.

const study = JSON.parse(byId('study').textContent);
const sensors = study.sensors.map(readSensor);
const { byArea } = study; // whether shares are of the area, else of the faces
const canvas = byId('canvas');
const still = matchMedia('(prefers-reduced-motion: reduce)');
const state = {
  mode: 'sensor', model: 0, view: '3D', on: sensors.map(() => true),
  focus: -1,   // sensor whose faces alone keep their colour
  kept: -1,    // focus that stays when the pointer leaves the list
  through: -1, // sensor that we look through
  bared: false, // whether obstacles fade, for what they hide
  frusta: false, obstacles: true, labels: true, edges: false, cut: false,
};
const MODES = [
  ['sensor', 'Sensors', 'Each face in the colour of the sensor that sees it most squarely'],
  ['overlap', 'Overlap', 'How many sensors see each face'],
  ['unseen', 'Unseen', 'The faces that no sensor sees, also through what hides them'],
];
let models, obstacles, painter, camera, glyphSize;
let aims = [];            // how far along its axis each sensor meets a surface
let covered, painted;     // counts of the current model, palette entries of its faces
let things = {};          // what is on the GPU: model, obstacles, bodies
let turned = 0;           // quarter turns that show the front of open scenes, radians
let home = null;          // camera and view to go back to from a sensor's view
let move = null;          // running blend of the camera
let idsFresh = false, pending = false, marked = -1;
let slow = false, steered = -1e9, rest = 0; // see frame()

// ---------------------------------------------------------------- drawing

function redraw() {
  idsFresh = false;
  if (!pending) { pending = true; requestAnimationFrame(frame); }
}

function frame(time) {
  pending = false;
  if (move) {
    const t = clamp((time - move.start) / move.duration, 0, 1);
    camera.state = Camera.between(move.from, move.to, t * t * (3 - 2 * t));
    if (t === 1) move = null;
  }
  // A scene too heavy for smooth motion is drawn coarser while it moves, and in full at rest.
  const moving = move !== null || time - steered < 200, coarse = slow && moving;
  resize(coarse ? 0.5 : 1);
  draw(coarse);
  if (!coarse) painter.timed((milliseconds) => { slow = milliseconds > 120; });
  clearTimeout(rest);
  rest = 0;
  if (move) redraw();
  else if (coarse) rest = setTimeout(redraw, 250);
}

function resize(quality = 1) {
  const ratio = Math.min(devicePixelRatio || 1, 2) * quality;
  const { clientWidth: w, clientHeight: h } = canvas;
  if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
    canvas.width = Math.max(1, Math.round(w * ratio));
    canvas.height = Math.max(1, Math.round(h * ratio));
  }
  if (camera.width !== w || camera.height !== h) {
    Object.assign(camera, { width: Math.max(w, 1), height: Math.max(h, 1) });
    if (state.through >= 0) camera.state = camera.through(sensors[state.through]);
  }
}

/** What is drawn; `toRead` leaves out what one looks through. */
function visibleThings(coarse = false, toRead = false) {
  const list = [coarse ? coarseModel() : things.model];
  if (things.obstacles && state.obstacles && !(toRead && state.bared)) list.push(things.obstacles);
  if (state.through < 0) list.push(things.bodies);
  return list;
}

/** The model with fewer faces, made when first needed; small models stay as they are. */
function coarseModel() {
  if (things.model.nFaces < 2e5) return things.model;
  if (!things.coarse) {
    const mesh = coarsened(models[state.model]);
    things.coarse = Object.assign(painter.upload(corners(mesh)), { origin: mesh.origin, painted: null });
  }
  if (things.coarse.painted !== painted) painter.setPaint(things.coarse, things.coarse.origin.map((f) => painted[f]));
  things.coarse.painted = painted;
  return Object.assign(things.coarse, { cutAway: state.cut });
}

function draw(coarse = false) {
  const shot = camera.shot();
  // Over the viewer's left shoulder, and never from below.
  const light = add(add(add(scaled(shot.direction, -1), shot.right, -0.45), shot.up, 0.55), camera.up, 0.35);
  Object.assign(things.model, { edges: state.edges, marked, ghost: state.mode === 'unseen' && state.through < 0, cutAway: state.cut });
  if (things.obstacles) Object.assign(things.obstacles, { cutAway: state.cut, veil: state.bared ? 0.24 : 1 });
  painter.setLines(sensorLines(sensors, state, glyphSize, aims));
  painter.draw(visibleThings(coarse), { ...shot, up: camera.up, keyLight: unit(light), pixel: canvas.width / camera.width });
  placeLabels(shot);
  placeScale(shot);
}

/** What lies under a CSS pixel: { kind: 'model' | 'obstacle' | 'sensor', face, ... } or null. */
function pickAt(x, y) {
  if (x < 0 || y < 0 || x >= camera.width || y >= camera.height) return null;
  if (!idsFresh) {
    let firstId = 1;
    const list = visibleThings(false, true);
    for (const thing of list) { thing.firstId = firstId; firstId += thing.nFaces; }
    painter.drawIds(list, camera.shot().worldToClip, Math.floor(camera.width), Math.floor(camera.height));
    idsFresh = true;
  }
  const id = painter.idAt(x, y);
  const thing = visibleThings(false, true).find((t) => id >= t.firstId && id < t.firstId + t.nFaces);
  if (!id || !thing) return null;
  const face = id - thing.firstId;
  if (thing === things.model) return { kind: 'model', model: models[state.model].name, face };
  if (thing === things.bodies) return { kind: 'sensor', sensor: things.bodies.owner[Math.floor(face / BODY_FACES)] };
  return { kind: 'obstacle', name: study.obstacles[thing.owner[face]].name };
}

// ---------------------------------------------------------------- changes of state

/** After any change of model, mode or sensors; `recount` where the numbers change too. */
function refresh(recount = true) {
  const mesh = models[state.model];
  if (recount) {
    covered = coverage(mesh, sensors, state.on);
    covered.gaps = gaps(mesh, covered.counts);
  }
  painted = paint(mesh, sensors, state, covered.counts);
  painter.setPaint(things.model, painted);
  const bodies = new Uint16Array(things.bodies.nFaces);
  const { owner, entry } = things.bodies;
  owner.forEach((s, b) => bodies.fill(state.on[s] ? entry[b] : DIM, b * BODY_FACES, (b + 1) * BODY_FACES));
  painter.setPaint(things.bodies, bodies);
  if (recount) showNumbers(mesh);
  showState(mesh);
  redraw();
}

function setModel(index) {
  state.model = (index + models.length) % models.length;
  const mesh = models[state.model];
  if (!mesh.normals) measure(mesh);
  for (const name of ['model', 'coarse']) if (things[name]) painter.release(things[name]);
  things.coarse = null;
  things.model = painter.upload(corners(mesh));
  aims = sensors.map((sensor) => aimOf(sensor, hiders(mesh)));
  marked = -1;
  hideReadout();
  refresh();
}

/** The meshes that may stop a sensor's axis; none where looking for that would take long. */
function hiders(mesh) {
  const meshes = [mesh, ...obstacles];
  return sensors.length * meshes.reduce((n, m) => n + m.nFaces, 0) < 3e7 ? meshes : [];
}

function setMode(mode) { state.mode = mode; refresh(false); }

/** Let obstacles fade, or be solid again. */
function bare(on) {
  if (state.bared === on) return;
  state.bared = on;
  showState(models[state.model]);
  redraw();
}

function setSensor(index, on) { state.on[index] = on; refresh(); }

function setFocus(index) {
  if (state.focus === index) return;
  state.focus = index;
  refresh(false);
}

/** Switch frusta, obstacles, labels, edges or cut. */
function show(name, on) {
  state[name] = on;
  showState(models[state.model]);
  redraw();
}

/** Move the camera there, smoothly unless the reader asked for less motion. */
function go(to, duration = 420) {
  if (still.matches || duration === 0) { move = null; camera.state = to; }
  else move = { from: { ...camera.state }, to, start: performance.now(), duration };
  redraw();
}

/** Room that the controls over the picture take, in CSS pixels. */
function insets() {
  const stage = canvas.getBoundingClientRect(), out = { top: 30, bottom: 30, side: 44 };
  for (const id of ['modes', 'views', 'legend']) {
    const box = byId(id).getBoundingClientRect();
    if (box.top < stage.top + stage.height / 2) out.top = Math.max(out.top, box.bottom - stage.top + 36); // and a label
    else out.bottom = Math.max(out.bottom, stage.bottom - box.top + 24);
  }
  return out;
}

/**
 * The quarter turn from which the model shows its front. A closed body shows as much front as
 * back from anywhere; furniture without backs, or half a room, does not.
 */
function bestTurn(mesh) {
  const front = (turn) => {
    const { direction: d } = camera.axes({ ...STANDARD['3D'], yaw: STANDARD['3D'].yaw + turn, roll: 0 });
    let towards = 0, all = 1e-30;
    for (let f = 0, k = 0; f < mesh.nFaces; f++, k += 3) {
      const c = mesh.areas[f] * (mesh.normals[k] * d[0] + mesh.normals[k + 1] * d[1] + mesh.normals[k + 2] * d[2]);
      towards += Math.max(-c, 0);
      all += Math.abs(c);
    }
    return towards / all;
  };
  const quarter = Math.PI / 2;
  return [quarter, 2 * quarter, 3 * quarter].reduce((best, turn) => (front(turn) > front(best) + 0.03 ? turn : best), 0);
}

function setView(name, duration) {
  leaveSensor(0);
  bare(false);
  go(camera.standard(name, insets(), turned), duration);
  markView(name);
}

/** Look through a sensor: its image fills the frame, only its own faces keep their colour. */
function lookThrough(index, duration) {
  if (!sensors.length) return;
  if (state.through < 0) home = { camera: { ...(move ? move.to : camera.state) }, view: state.view };
  bare(false);
  reveal();
  state.through = (index + sensors.length) % sensors.length;
  state.kept = state.focus = state.through;
  refresh(false);
  showThrough();
  go(camera.through(sensors[state.through]), duration);
}

function leaveSensor(duration) {
  if (state.through < 0) return;
  state.through = state.kept = state.focus = -1;
  refresh(false);
  showThrough();
  go(home.camera, duration);
  markView(home.view);
}

/** Fly to a patch that nobody sees. */
function goToGap(gap) {
  leaveSensor(0);
  setMode('unseen');
  bare(true);
  reveal();
  const d = norm(gap.normal) > 0.1 * gap.area ? scaled(unit(gap.normal), -1) : camera.axes().direction;
  go({ ...camera.facing(d), target: gap.center, h: 2.2 * gap.radius, tan: PERSPECTIVE });
  markView('');
}

/** Where the panel lies below the stage, as on a phone: scroll to what has just changed. */
function reveal() {
  const box = byId('stage').getBoundingClientRect();
  if (box.top < 0 && box.width >= innerWidth - 1) byId('stage').scrollIntoView({ behavior: still.matches ? 'auto' : 'smooth', block: 'start' });
}

// ---------------------------------------------------------------- start

function buildScene(bytes) {
  models = study.models.map((entry) => readMesh(bytes, entry));
  obstacles = study.obstacles.map((entry) => readMesh(bytes, entry));
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  const include = (v) => {
    for (let i = 0; i < v.length; i++) {
      low[i % 3] = Math.min(low[i % 3], v[i]);
      high[i % 3] = Math.max(high[i % 3], v[i]);
    }
  };
  models.forEach((mesh) => include(mesh.vertices));
  const box = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((j) => (k >> j & 1 ? high : low)[j]));
  const inside = sensors.filter((s) => s.center.every((x, i) => x > low[i] && x < high[i]));
  state.cut = inside.length > sensors.length / 2; // a room: look in through its walls
  sensors.forEach((sensor) => include(sensor.center));
  glyphSize = 0.032 * norm(sub(high, low));
  const points = [...box, ...sensors.flatMap((s) => [s.center, add(s.center, s.direction, -0.6 * glyphSize), ...(s.second ? [s.second.center] : [])])];
  obstacles.forEach((mesh) => include(mesh.vertices));
  sensors.forEach((s) => {
    include(add(s.center, s.direction, s.max_distance));
    if (!s.field.flat) for (const line of s.field.borders) line.forEach((d) => include(endOf(s, s.field, d, s.max_distance)));
  });
  camera = new Camera(study.up, {
    center: scaled(add(low, high), 0.5), radius: norm(sub(high, low)) / 2, points });
  resize();
  painter.setPalette([
    study.colors.unseen, study.colors.seen, study.colors.dim, study.colors.obstacle,
    ...sensors.map((s) => s.rgb), ...study.colors.overlap.slice(1),
    ...sensors.map((s) => s.second?.rgb ?? s.rgb)]);
  const bodies = bodiesOf(sensors, glyphSize), firstSecond = FIRST_SENSOR + sensors.length + study.colors.overlap.length - 1;
  things.bodies = Object.assign(painter.upload(corners(bodyMesh(bodies))), {
    owner: bodies.map((body) => body.owner), entry: bodies.map((body) => (body.isSecond ? firstSecond : FIRST_SENSOR) + body.owner) });
  if (obstacles.length) {
    const mesh = merged(obstacles);
    things.obstacles = Object.assign(painter.upload(corners(mesh)), { owner: mesh.owner });
    painter.setPaint(things.obstacles, new Uint16Array(mesh.nFaces).fill(OBSTACLE));
  }
}

function say(message) {
  byId('notice').textContent = message;
  byId('notice').hidden = false;
}

async function start() {
  byId('details').append(...details(study));
  byId('subtitle').textContent = study.subtitle;
  painter = new Painter(canvas);
  canvas.addEventListener('webglcontextlost', () => say('The graphics driver gave up. Load the page again.'));
  const text = byId('meshes');
  const bytes = await unpack(text.textContent);
  text.remove(); // its memory is worth more than its presence
  buildScene(bytes);
  buildControls();
  setModel(0);
  turned = bestTurn(models[0]);
  setView('3D', 0);
  fromHash();
  new ResizeObserver(redraw).observe(canvas);
  await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  byId('notice').hidden = true;
  window.glvis.firstPicture = performance.now();
}

window.glvis = {
  ready: start().catch((error) => {
    say(error.message);
    throw error;
  }),
  state, pickAt, setMode, setModel, setSensor, setView, lookThrough, leaveSensor, show,
  read: (face) => readFace(models[state.model], face),
  quality: (face, some) => qualityWords(models[state.model], face, some),
  frame: () => camera.frame(sensors[state.through]),
  covered: () => covered,
  aims: () => aims,
  lines: () => sensorLines(sensors, state, glyphSize, aims),
  coarsened,
  camera: () => camera,
  model: () => models[state.model],
  settled: () => !move && !pending && !rest,
};
