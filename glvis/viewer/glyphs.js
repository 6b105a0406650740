// What a sensor looks like in the scene: body, image plane, axis, frustum over its range.

const BODY_FACES = 18; // a box of 12 and a pyramid of 6

/** Bodies of all sensors as one mesh; `size` in scene units. */
function sensorBodies(sensors, size) {
  const vertices = [], faces = [];
  for (const sensor of sensors) {
    const at = (x, y, depth) => {
      const p = add(add(add(sensor.center, sensor.right, x * size), sensor.up, y * size), sensor.direction, depth * size);
      vertices.push(...p);
      return vertices.length / 3 - 1;
    };
    const quad = (a, b, c, d) => faces.push(a, b, c, a, c, d);
    const x = 0.42, y = 0.3, deep = 0.62, [tx, ty] = sensor.tan_half, k = 0.5 / Math.max(tx, ty);
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

/** Segments for Painter.setLines: axes and up-marks always, frusta where `state` wants them. */
function sensorLines(sensors, state, size) {
  const segments = [];
  sensors.forEach((sensor, s) => {
    if (!state.on[s] || state.through >= 0) return; // through a sensor, only the scene
    const focused = state.focus === s, faint = state.focus >= 0 && !focused ? 0.25 : 1;
    const color = sensor.rgb, [tx, ty] = sensor.tan_half;
    const at = (x, y, depth) => add(add(add(sensor.center, sensor.right, x * tx * depth), sensor.up, y * ty * depth), sensor.direction, depth);
    const draw = (a, b, opacity, width = 1.25) => segments.push([a, b, color, opacity * faint, width]);
    const loop = (points, opacity, width) => points.forEach((p, i) => draw(p, points[(i + 1) % points.length], opacity, width));
    const rectangle = (depth) => [at(-1, -1, depth), at(1, -1, depth), at(1, 1, depth), at(-1, 1, depth)];
    const { min_distance: near, max_distance: far } = sensor;
    const plane = size * 0.45 / Math.max(tx, ty);
    const up = (x, y) => add(add(add(sensor.center, sensor.direction, plane), sensor.right, x * size), sensor.up, y * size);
    const top = 0.5 * ty / Math.max(tx, ty);
    loop([up(-0.16, top + 0.1), up(0.16, top + 0.1), up(0, top + 0.34)], 1, 2);
    draw(at(0, 0, plane), at(0, 0, far), 0.75, focused ? 2 : 1.25);
    if (!state.frusta && !focused) return;
    const weight = focused ? 1.75 : 1.25, range = focused ? 0.85 : 0.5;
    rectangle(far).forEach((corner, i) => {
      const start = rectangle(near)[i];
      draw(sensor.center, start, 0.3, weight);
      draw(start, corner, range, weight);
    });
    loop(rectangle(near), range, weight);
    loop(rectangle(far), range, weight);
  });
  return segments;
}
