// What a sensor looks like in the scene: body, image plane, axis, frustum over its range.

const BODY_FACES = 18; // a box of 12 and a pyramid of 6

/** Whose bodies are drawn: all sensors, then the second viewpoints that stand clear of the first. */
function bodiesOf(sensors, size) {
  const apart = ({ second, center }) => second && norm(sub(second.center, center)) > 0.9 * size;
  return [
    ...sensors.map((sensor, owner) => ({ ...sensor, owner, size })),
    ...sensors.flatMap((sensor, owner) => (apart(sensor) ? [{ ...sensor.second, owner, size: 0.6 * size, isSecond: true }] : [])),
  ];
}

/** Bodies as one mesh. */
function bodyMesh(bodies) {
  const vertices = [], faces = [];
  for (const sensor of bodies) {
    const { size } = sensor;
    const at = (x, y, depth) => {
      const p = add(add(add(sensor.center, sensor.right, x * size), sensor.up, y * size), sensor.direction, depth * size);
      vertices.push(...p);
      return vertices.length / 3 - 1;
    };
    const quad = (a, b, c, d) => faces.push(a, b, c, a, c, d);
    const x = 0.42, y = 0.3, deep = 0.62, [tx, ty] = sensor.body, k = 0.5 / Math.max(tx, ty);
    // The box behind the optical centre: front ring 0-3, back ring 4-7, each counter-clockwise from behind.
    const ring = (depth) => [at(-x, -y, depth), at(x, -y, depth), at(x, y, depth), at(-x, y, depth)];
    const back = ring(-deep), front = ring(0);
    quad(...back);
    quad(front[1], front[0], front[3], front[2]);
    for (let i = 0; i < 4; i++) quad(back[(i + 1) % 4], back[i], front[i], front[(i + 1) % 4]);
    // The pyramid from the centre to the image plane, in the proportions of the field of view.
    const apex = at(0, 0, 0), base = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([i, j]) => at(i * tx * k, j * ty * k, k * 0.9));
    for (let i = 0; i < 4; i++) faces.push(apex, base[i], base[(i + 1) % 4]);
    quad(base[1], base[0], base[3], base[2]);
  }
  const nFaces = faces.length / 3;
  return measure({ vertices: new Float32Array(vertices), faces: new Uint32Array(faces), nFaces });
}

/** How far along its axis a sensor meets one of the meshes; Infinity where it meets none. */
function aimOf(sensor, meshes) {
  const [ox, oy, oz] = sensor.center, [dx, dy, dz] = sensor.direction;
  let nearest = Infinity;
  for (const { vertices: v, faces: f } of meshes) {
    for (let k = 0; k < f.length; k += 3) { // Moeller and Trumbore 1997
      const a = 3 * f[k], b = 3 * f[k + 1], c = 3 * f[k + 2];
      const ux = v[b] - v[a], uy = v[b + 1] - v[a + 1], uz = v[b + 2] - v[a + 2];
      const wx = v[c] - v[a], wy = v[c + 1] - v[a + 1], wz = v[c + 2] - v[a + 2];
      const px = dy * wz - dz * wy, py = dz * wx - dx * wz, pz = dx * wy - dy * wx;
      const det = ux * px + uy * py + uz * pz;
      if (det === 0) continue;
      const tx = ox - v[a], ty = oy - v[a + 1], tz = oz - v[a + 2], s = (tx * px + ty * py + tz * pz) / det;
      if (s < 0 || s > 1) continue;
      const qx = ty * uz - tz * uy, qy = tz * ux - tx * uz, qz = tx * uy - ty * ux, t = (dx * qx + dy * qy + dz * qz) / det;
      if (t < 0 || s + t > 1) continue;
      const far = (wx * qx + wy * qy + wz * qz) / det;
      if (far > 0 && far < nearest) nearest = far;
    }
  }
  return nearest;
}

/** The lines of an ideal pinhole's field of view, as field.py gives those of every lens. */
function pinholeField([tx, ty]) {
  const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([i, j]) => [i * tx, j * ty, -1]);
  return { centre: [0, 0, 0], flat: true, borders: [[...corners, corners[0]]], ribs: [], rays: corners };
}

/** Where a direction of a field ends, in the scene: at a depth of the sensor, or a range from the centre. */
function endOf(sensor, field, d, reach) {
  const far = field.flat ? Math.max(reach + field.centre[2], 0) / -d[2] : reach / norm(d);
  return placeOf(sensor, add(field.centre, d, far));
}

/** A line in pieces with gaps, or whole where `dash` is 0: calls `draw(from, to)`. */
function broken(a, b, dash, draw) {
  const n = dash ? clamp(Math.round(norm(sub(b, a)) / dash), 1, 200) : 1, part = dash ? 0.55 : 1;
  for (let i = 0; i < n; i++) draw(add(a, sub(b, a), i / n), add(a, sub(b, a), (i + part) / n));
}

/**
 * Segments for Painter.setLines: axes as far as the sensor aims, up-marks and the beginnings of
 * frusta always; whole frusta where `state` wants them, they fill the picture. A second viewpoint
 * has a baseline and broken lines, and what both see a border of its own.
 */
function sensorLines(sensors, state, size, aims) {
  const segments = [], crowd = Math.min(1, 8 / sensors.length); // frusta of many are fainter
  sensors.forEach((sensor, s) => {
    if (!state.on[s] || state.through >= 0) return; // through a sensor, only the scene
    const focused = state.focus === s, faint = state.focus >= 0 && !focused ? 0.25 : 1;
    const color = sensor.rgb, [tx, ty] = sensor.body;
    const draw = (a, b, opacity, width = 1.25, tint = color) => segments.push([a, b, tint, opacity * faint, width]);
    const loop = (points, opacity, width) => points.forEach((p, i) => draw(p, points[(i + 1) % points.length], opacity, width));
    const { min_distance: near, max_distance: far } = sensor, ahead = (depth) => add(sensor.center, sensor.direction, depth);
    const plane = size * 0.45 / Math.max(tx, ty);
    const up = (x, y) => add(add(add(sensor.center, sensor.direction, plane), sensor.right, x * size), sensor.up, y * size);
    const top = 0.5 * ty / Math.max(tx, ty);
    loop([up(-0.16, top + 0.1), up(0.16, top + 0.1), up(0, top + 0.34)], 1, 2);
    const whole = state.frusta || focused, short = Math.min(Math.max(0.3 * Math.min(aims[s], far), 2 * size), far);
    const end = whole ? far : Number.isFinite(aims[s]) ? Math.min(aims[s], far) : short;
    draw(ahead(plane), ahead(Math.max(end, plane)), 0.75, focused ? 2 : 1.25);
    const weight = focused ? 1.75 : 1.25, range = focused ? 0.85 : 0.5;
    const parts = [{ field: sensor.field, tint: color, dash: 0 }];
    if (sensor.second) {
      draw(sensor.center, sensor.second.center, 1, 1.75, sensor.second.rgb);
      parts.push({ field: sensor.second.field, tint: sensor.second.rgb, dash: whole ? far / 40 : size / 2 });
    }
    for (const { field, tint, dash } of parts) {
      const line = (a, b, opacity, width) => broken(a, b, dash, (p, q) => draw(p, q, opacity, width, tint));
      const at = (d, reach) => endOf(sensor, field, d, reach), centre = placeOf(sensor, field.centre);
      const along = (directions, reach, opacity, width) => directions.slice(1).forEach((d, i) => line(at(directions[i], reach), at(d, reach), opacity, width));
      const rims = (reach, opacity, width) => {
        field.borders.forEach((border) => along(border, reach, opacity, width));
        field.ribs.forEach((rib) => along(rib, reach, opacity / 2, width));
      };
      if (!whole) {
        for (const d of field.rays)
          for (const [begin, stop, opacity] of [[0, 0.4, 0.6], [0.4, 0.75, 0.42], [0.75, 1, 0.28]])
            line(...[begin, stop].map((t) => add(centre, sub(at(d, short), centre), t)), opacity * crowd);
        rims(short, 0.28 * crowd);
        continue;
      }
      for (const d of field.rays) {
        line(centre, at(d, near), 0.3, weight);
        line(at(d, near), at(d, far), range, weight);
      }
      rims(near, range, weight);
      rims(far, range, weight);
    }
    if (whole && sensor.second) for (const border of sensor.second.common) loop(border.map((p) => placeOf(sensor, p)), 0.9, 2.5);
  });
  return segments;
}
