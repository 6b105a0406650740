// The eye. One state serves all views: turntable, nearly parallel (top, front, side) and the
// view through a sensor; going from one to another is a straight blend of its numbers.

const PERSPECTIVE = Math.tan(Math.PI / 10); // tangent of half the vertical field of view
const PARALLEL = 0.004;                     // far away and long: parallel to half a pixel
const STANDARD = { // yaw 0 looks along `forward`, pitch -90 degrees straight down
  '3D': { yaw: -0.62, pitch: -0.42, tan: PERSPECTIVE },
  Top: { yaw: 0, pitch: -Math.PI / 2, tan: PARALLEL },
  Front: { yaw: 0, pitch: 0, tan: PARALLEL },
  Side: { yaw: -Math.PI / 2, pitch: 0, tan: PARALLEL },
};

class Camera {
  /**
   * `up` is the study's; right is the world's X (Y where up is X), forward = up x right.
   * `sphere` is what a view must show: { center, radius, points }.
   */
  constructor(up, sphere) {
    this.up = unit(up);
    const axis = Math.abs(this.up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
    this.right = unit(sub(axis, scaled(this.up, dot(axis, this.up))));
    this.forward = cross(this.up, this.right);
    this.sphere = sphere;
    this.width = this.height = 1;
    this.state = { target: sphere.center, yaw: 0, pitch: 0, roll: 0, h: sphere.radius, tan: PERSPECTIVE };
  }

  /** Unit axes of the image for a state: right, up, direction. */
  axes({ yaw, pitch, roll } = this.state) {
    const level = add(scaled(this.forward, Math.cos(yaw)), this.right, Math.sin(yaw));
    const direction = add(scaled(level, Math.cos(pitch)), this.up, Math.sin(pitch));
    const right0 = add(scaled(this.right, Math.cos(yaw)), this.forward, -Math.sin(yaw));
    const up0 = cross(right0, direction);
    return {
      right: add(scaled(right0, Math.cos(roll)), up0, -Math.sin(roll)),
      up: add(scaled(right0, Math.sin(roll)), up0, Math.cos(roll)),
      direction,
    };
  }

  get aspect() { return this.width / this.height; }

  eye(state = this.state) {
    return add(state.target, this.axes(state).direction, -state.h / state.tan);
  }

  /** Eye, axes and matrices of the current state. */
  shot() {
    const { right, up, direction } = this.axes(), eye = this.eye(), { tan } = this.state;
    const middle = dot(sub(this.sphere.center, eye), direction);
    const far = Math.max(middle + this.sphere.radius * 1.5, this.sphere.radius * 0.01);
    const near = Math.max(middle - this.sphere.radius * 1.5, far * 1e-3);
    const view = worldToCamera(eye, right, up, direction);
    const worldToClip = multiply(perspective(tan * this.aspect, tan, near, far), view);
    return { eye, right, up, direction, worldToClip };
  }

  /** CSS pixels (x right, y down) and depth of a point. */
  project(point, m = this.shot().worldToClip) {
    const clip = [0, 1, 3].map((r) => m[r] * point[0] + m[4 + r] * point[1] + m[8 + r] * point[2] + m[12 + r]);
    const [x, y, w] = clip;
    return { x: (1 + x / w) / 2 * this.width, y: (1 - y / w) / 2 * this.height, depth: w };
  }

  /**
   * A standard view that shows all of the scene's points inside the canvas less `inset`,
   * CSS pixels on { top, bottom, side }; `turned` adds to the yaw of the perspective view.
   */
  standard(name, inset, turned = 0) {
    const { yaw, pitch, tan } = STANDARD[name];
    const state = { target: this.sphere.center, yaw: name === '3D' ? yaw + turned : yaw, pitch, roll: 0, h: this.sphere.radius, tan };
    const freeY = Math.max(this.height - inset.top - inset.bottom, this.height / 4) / this.height;
    const freeX = Math.max(this.width - 2 * inset.side, this.width / 4) / this.width;
    const axes = this.axes(state);
    // Centre what the points fill on the screen, then size it; perspective makes both depend
    // on each other, so a few rounds.
    for (let round = 0; round < 8; round++) {
      const eye = this.eye(state), extent = (axis) => {
        const slopes = this.sphere.points.map((p) => dot(sub(p, eye), axis) / Math.max(dot(sub(p, eye), axes.direction), state.h * 0.1));
        return [Math.min(...slopes), Math.max(...slopes)];
      };
      const [left, right] = extent(axes.right), [low, high] = extent(axes.up), distance = state.h / tan;
      const grow = Math.max((high - low) / (2 * tan * freeY), (right - left) / (2 * tan * this.aspect * freeX));
      state.target = add(add(state.target, axes.right, (left + right) / 2 * distance), axes.up, (low + high) / 2 * distance);
      state.h *= grow ** 0.8;
    }
    state.target = add(state.target, axes.up, state.h * (inset.top - inset.bottom) / this.height);
    return state;
  }

  /** Angles of a view along a unit direction. */
  facing(d) {
    const level = Math.hypot(dot(d, this.forward), dot(d, this.right));
    const yaw = level > 1e-9 ? Math.atan2(dot(d, this.right), dot(d, this.forward)) : 0;
    return { yaw, pitch: Math.atan2(dot(d, this.up), level), roll: 0 };
  }

  /** The view through a sensor, whose image fills the rectangle that `frame` returns. */
  through(sensor) {
    const d = sensor.direction, { yaw, pitch } = this.facing(d), axes = this.axes({ yaw, pitch, roll: 0 });
    const roll = Math.atan2(-dot(sensor.right, axes.up), dot(sensor.right, axes.right));
    const distance = (Math.max(sensor.min_distance, 0.2 * sensor.max_distance) + sensor.max_distance) / 2;
    const tan = sensor.tan_half[1] * this.height / this.frame(sensor).height;
    return { target: add(sensor.center, d, distance), yaw, pitch, roll, h: distance * tan, tan };
  }

  /** Rectangle, in CSS pixels, of a sensor's image in the view through it. */
  frame(sensor) {
    const [tx, ty] = sensor.tan_half;
    const k = Math.min((this.width - 32) / tx, (this.height - 128) / ty);
    const width = tx * k, height = ty * k;
    return { left: (this.width - width) / 2, top: (this.height - height) / 2, width, height };
  }

  turn(dx, dy) {
    this.state.yaw += dx;
    this.state.pitch = clamp(this.state.pitch - dy, -Math.PI / 2, Math.PI / 2);
    if (this.state.tan < PERSPECTIVE / 2) this.state.tan = PERSPECTIVE; // h stays: same size
  }

  /** Move by CSS pixels. */
  pan(dx, dy) {
    const { right, up } = this.axes(), k = 2 * this.state.h / this.height;
    this.state.target = add(add(this.state.target, right, -dx * k), up, dy * k);
  }

  /** Zoom by a factor on the seen height; the point under the CSS pixel (x, y) stays put. */
  zoom(factor, x = this.width / 2, y = this.height / 2) {
    const h = clamp(this.state.h * factor, this.sphere.radius * 1e-3, this.sphere.radius * 20);
    const { right, up } = this.axes(), k = 2 * (this.state.h - h) / this.height;
    this.state.target = add(add(this.state.target, right, (x - this.width / 2) * k), up, (this.height / 2 - y) * k);
    this.state.h = h;
  }

  /** The state at a share t of the way from a to b. */
  static between(a, b, t) {
    const turnBetween = (p, q) => p + t * (((q - p + Math.PI) % (2 * Math.PI) + 2 * Math.PI) % (2 * Math.PI) - Math.PI);
    const grow = (p, q) => p * (q / p) ** t;
    return {
      target: a.target.map((x, i) => mix(x, b.target[i], t)),
      yaw: turnBetween(a.yaw, b.yaw), pitch: mix(a.pitch, b.pitch, t), roll: turnBetween(a.roll, b.roll),
      h: grow(a.h, b.h), tan: grow(a.tan, b.tan),
    };
  }
}

/** Mouse, touch, wheel: calls camera methods through `act`, taps and hovering through `on`. */
function steer(canvas, on) {
  const pointers = new Map();
  let moved = 0;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  };
  canvas.addEventListener('contextmenu', (event) => event.preventDefault());
  canvas.addEventListener('pointerdown', (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, place(event));
    if (pointers.size === 1) moved = 0;
  });
  canvas.addEventListener('pointermove', (event) => {
    const to = place(event), from = pointers.get(event.pointerId);
    if (!from) { on.hover(to.x, to.y); return; }
    const dx = to.x - from.x, dy = to.y - from.y;
    moved += Math.hypot(dx, dy);
    if (moved < 4) return; // a tap trembles
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
      const apart = (p) => Math.hypot(p.x - other.x, p.y - other.y) || 1;
      on.zoom(apart(from) / apart(to), (to.x + other.x) / 2, (to.y + other.y) / 2);
      on.pan(dx / 2, dy / 2);
    } else if (event.buttons & 6 || event.shiftKey) on.pan(dx, dy);
    else on.turn(dx * 0.007, dy * 0.007);
    pointers.set(event.pointerId, to);
  });
  const lift = (event) => {
    const at = place(event);
    if (pointers.delete(event.pointerId) && event.type === 'pointerup' && moved < 4 && !pointers.size)
      on.tap(at.x, at.y, event.pointerType);
  };
  canvas.addEventListener('pointerup', lift);
  canvas.addEventListener('pointercancel', lift);
  canvas.addEventListener('pointerleave', (event) => event.pointerType === 'mouse' && on.leave());
  canvas.addEventListener('dblclick', (event) => on.center(place(event).x, place(event).y));
  canvas.addEventListener('wheel', (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 30 : 1, at = place(event);
    on.zoom(Math.exp(clamp(event.deltaY * lines, -240, 240) * 0.0016), at.x, at.y);
  }, { passive: false });
}
