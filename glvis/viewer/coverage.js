// Who sees what: shares, colours and readings, all from the bits of the visibility maps.

// Entries of the palette texture; then S sensors, then counts 1 .. S.
const UNSEEN = 0, SEEN = 1, DIM = 2, OBSTACLE = 3, FIRST_SENSOR = 4;

const rgbOf = (color) => [1, 3, 5].map((i) => parseInt(color.slice(i, i + 2), 16));

/** Axes and centre out of a pose (row-major). */
function axesOf(m) {
  const column = (c) => [m[0][c], m[1][c], m[2][c]];
  return { right: column(0), up: column(1), direction: scaled(column(2), -1), center: column(3) };
}

/** Sensors as the page uses them; one that says nothing of its lens is an ideal pinhole. */
function readSensor(entry) {
  const sensor = {
    distance: 'depth', lens: 'pinhole', second: null, field: pinholeField(entry.tan_half), body: entry.tan_half,
    ...entry, ...axesOf(entry.camera_to_world), rgb: rgbOf(entry.color),
  };
  if (sensor.second) { // its pose is given in the frame of the first
    const { right, up, direction, center } = axesOf(sensor.second.pose), turned = (v) => sub(placeOf(sensor, v), sensor.center);
    Object.assign(sensor.second, { right: turned(right), up: turned(up), direction: turned(direction), center: placeOf(sensor, center), rgb: rgbOf(sensor.second.colors[Number(matchMedia('(prefers-color-scheme: dark)').matches)]) });
  }
  return sensor;
}

/** A point of a sensor's camera frame (right, up, back) in the scene. */
const placeOf = (sensor, [x, y, z]) => add(add(add(sensor.center, sensor.right, x), sensor.up, y), sensor.direction, -z);

/** Where a face lies before a sensor: its distance, as the sensor measures it, and cosine of the incidence. */
function faceSeenFrom(mesh, face, sensor, incidence) {
  const k = 3 * face, c = mesh.centroids, n = mesh.normals;
  const ray = [c[k] - sensor.center[0], c[k + 1] - sensor.center[1], c[k + 2] - sensor.center[2]];
  const normal = [n[k], n[k + 1], n[k + 2]];
  const along = incidence === 'axis' ? sensor.direction : scaled(ray, 1 / (norm(ray) || 1));
  return { ray, distance: sensor.distance === 'range' ? norm(ray) : dot(ray, sensor.direction), cosine: -dot(normal, along) };
}

/** How good a view of a face is, in words, by the best of some sensors that see it; '' where nothing is known. */
function qualityWords(mesh, face, some) {
  return mesh.qualities.map(({ label, unit, of }) => {
    const best = Math.min(...some.filter((s) => mesh.sees(s, face)).map((s) => of(s, face)).filter(Number.isFinite));
    return Number.isFinite(best) ? label.replace('#', `${twoDigits(best)}\u00a0${unit}`) : '';
  }).filter(Boolean).join(', ');
}

/** Everything the page tells about one model with some sensors on; amounts are faces, or area where any are cut. */
function coverage(mesh, sensors, on) {
  const S = sensors.length, F = mesh.nFaces;
  const weight = byArea ? (f) => mesh.areas[f] : () => 1;
  const counts = new Uint16Array(F);
  const last = new Uint16Array(F); // the one sensor, where there is only one
  const seen = mesh.seen ??= sensors.map((_, s) => {
    let n = 0;
    for (let f = 0; f < F; f++) if (mesh.sees(s, f)) n += weight(f);
    return n;
  });
  for (let s = 0; s < S; s++)
    if (on[s]) for (let f = 0; f < F; f++) if (mesh.sees(s, f)) { counts[f]++; last[f] = s; }
  const exactly = new Array(S + 1).fill(0); // seen by exactly 0, 1, ... sensors
  const alone = new Array(S).fill(0);
  let unseenArea = 0;
  for (let f = 0; f < F; f++) {
    exactly[counts[f]] += weight(f);
    if (counts[f] === 0) unseenArea += mesh.areas[f];
    else if (counts[f] === 1) alone[last[f]] += weight(f);
  }
  return { counts, exactly, seen, alone, unseenArea, all: exactly.reduce((a, b) => a + b) };
}

/** Of the sensors that are on, the one that sees each face most squarely; -1 where none does. */
function squarestSensor(mesh, sensors, on, incidence) {
  const best = new Int16Array(mesh.nFaces).fill(-1);
  const largest = new Float32Array(mesh.nFaces).fill(-2); // cosine
  sensors.forEach((sensor, s) => {
    if (!on[s]) return;
    const [cx, cy, cz] = sensor.center, [dx, dy, dz] = sensor.direction, c = mesh.centroids, n = mesh.normals;
    for (let f = 0, k = 0; f < mesh.nFaces; f++, k += 3) {
      if (!mesh.sees(s, f)) continue;
      let x = dx, y = dy, z = dz, length = 1;
      if (incidence === 'ray') {
        x = c[k] - cx; y = c[k + 1] - cy; z = c[k + 2] - cz;
        length = Math.sqrt(x * x + y * y + z * z) || 1;
      }
      const cosine = -(x * n[k] + y * n[k + 1] + z * n[k + 2]) / length;
      if (cosine > largest[f]) { largest[f] = cosine; best[f] = s; }
    }
  });
  return best;
}

/** The palette entry of each face; `focus` is a sensor whose faces alone keep a colour, or -1. */
function paint(mesh, sensors, { mode, on, focus }, counts) {
  const S = sensors.length, out = new Uint16Array(mesh.nFaces);
  const best = mode === 'sensor' && focus < 0 ? squarestSensor(mesh, sensors, on, study.incidence) : null;
  for (let f = 0; f < out.length; f++) {
    const count = counts[f];
    if (focus >= 0) out[f] = mesh.sees(focus, f) ? FIRST_SENSOR + focus : count || mode !== 'unseen' ? DIM : UNSEEN;
    else if (!count) out[f] = UNSEEN;
    else if (mode === 'unseen') out[f] = SEEN;
    else out[f] = FIRST_SENSOR + (mode === 'overlap' ? S + count - 1 : best[f]);
  }
  return out;
}

/** For each face the first of those that it hangs together with over edges, among faces of count 0. */
function patchOf({ faces, nFaces, vertices }, counts) {
  const parent = new Uint32Array(nFaces).map((_, f) => f); // a forest over the faces
  const root = (f) => {
    while (parent[f] !== f) f = parent[f] = parent[parent[f]];
    return f;
  };
  const eachEdge = (act) => {
    for (let f = 0; f < nFaces; f++)
      if (!counts[f]) for (let k = 0; k < 3; k++) {
        const a = faces[3 * f + k], b = faces[3 * f + (k + 1) % 3];
        act(f, Math.min(a, b), Math.max(a, b));
      }
  };
  const start = new Uint32Array(vertices.length / 3 + 1); // edges by the lower of their vertices
  eachEdge((f, low) => { start[low + 1]++; });
  for (let v = 1; v < start.length; v++) start[v] += start[v - 1];
  const next = start.slice(), ends = new Uint32Array(start.at(-1)), owners = new Uint32Array(ends.length);
  eachEdge((f, low, high) => { ends[next[low]] = high; owners[next[low]++] = f; });
  for (let v = 0; v + 1 < start.length; v++)
    for (let i = start[v]; i < start[v + 1]; i++)
      for (let j = start[v]; j < i; j++) if (ends[i] === ends[j]) {
        const [a, b] = [root(owners[i]), root(owners[j])];
        parent[Math.max(a, b)] = Math.min(a, b);
        break;
      }
  return root;
}

/** Patches of unseen faces, as 'explain' tells them, the largest first: { area, nFaces, center, normal, radius }. */
function gaps(mesh, counts) {
  const { centroids: c } = mesh, root = patchOf(mesh, counts), patches = new Map();
  for (let f = 0; f < mesh.nFaces; f++) {
    if (counts[f]) continue;
    const key = root(f), weight = mesh.areas[f];
    let patch = patches.get(key);
    if (!patch) patches.set(key, patch = { area: 0, faces: [], center: [0, 0, 0], normal: [0, 0, 0] });
    patch.area += weight;
    patch.faces.push(f);
    for (let j = 0; j < 3; j++) {
      patch.center[j] += weight * c[3 * f + j];
      patch.normal[j] += weight * mesh.normals[3 * f + j];
    }
  }
  return [...patches.values()].filter((p) => p.area > 0).sort((a, b) => b.area - a.area).slice(0, 6).map((p) => {
    const center = scaled(p.center, 1 / p.area);
    const radius = p.faces.reduce((r, f) => Math.max(r, Math.hypot(c[3 * f] - center[0], c[3 * f + 1] - center[1], c[3 * f + 2] - center[2])), 0);
    return { area: p.area, nFaces: p.faces.length, center, normal: p.normal, radius: Math.max(radius, Math.sqrt(p.area)) };
  });
}
