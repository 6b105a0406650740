// Controls and overlays: sensor list, legend, labels, scale bar, readings, keys.

let markMode, markView, markModel;
const rows = [], labels = [], toggles = {};

function buildControls() {
  markMode = choice(byId('modes'), MODES, setMode);
  const press = choice(byId('views'), [
    ['3D', '3D', 'Perspective (key 1)'], ['Top', 'Top', 'From above (2)'],
    ['Front', 'Front', 'From the front (3)'], ['Side', 'Side', 'From the side (4)']], (name) => setView(name), 'press');
  markView = (name) => press(state.view = name);
  byId('views').append(element('button', { type: 'button', 'aria-label': 'Mouse, touch and keys', title: 'Keys (?)', click: toggleKeys }, '?'));
  byId('keys-close').addEventListener('click', toggleKeys);
  byId('back').addEventListener('click', () => leaveSensor());
  byId('previous').addEventListener('click', () => lookThrough(state.through - 1));
  byId('next').addEventListener('click', () => lookThrough(state.through + 1));
  buildModels();
  buildSensors();
  buildToggles();
  steer(canvas, {
    turn: (dx, dy) => unlessThrough(() => { camera.turn(dx, dy); markView(''); }),
    pan: (dx, dy) => unlessThrough(() => camera.pan(dx, dy)),
    zoom: (factor, x, y) => unlessThrough(() => camera.zoom(factor, x, y)),
    hover: (x, y) => { hover.at = [x, y]; if (!hover.queued) { hover.queued = true; requestAnimationFrame(hover); } },
    tap: (x, y, pointer) => tap(x, y, pointer),
    leave: hideReadout,
    center: (x, y) => unlessThrough(() => centerOn(x, y)),
  });
  document.addEventListener('keydown', onKey);
}

/** The camera of a sensor's view is bolted down. */
function unlessThrough(act) {
  if (state.through >= 0) return;
  move = null;
  steered = performance.now();
  act();
  hideReadout();
  redraw();
}

function buildModels() {
  if (models.length < 2) return;
  const host = byId('models'), select = element('select', { id: 'model', change: () => setModel(select.selectedIndex) },
    models.map((mesh) => element('option', {}, mesh.name)));
  const step = (by, text, name) => element('button', { type: 'button', 'aria-label': name, click: () => setModel(state.model + by) }, text);
  host.append(element('label', { for: 'model' }, 'Model'), step(-1, '‹', 'Previous model'), select, step(1, '›', 'Next model'));
  host.hidden = false;
  markModel = () => { select.selectedIndex = state.model; };
}

function buildSensors() {
  const host = byId('sensors'), kinds = new Set(sensors.map((sensor) => sensor.kind)).size, noun = byArea ? 'area' : 'faces';
  const all = (on) => element('button', { type: 'button', class: 'link', click: () => { state.on.fill(on); refresh(); } }, on ? 'All' : 'None');
  host.querySelector('h2').append(element('span', { class: 'right' }, all(true), all(false)));
  host.append(element('div', { class: 'row head', 'aria-hidden': 'true' },
    element('span', { class: 'wide' }, 'Click for its faces'),
    element('span', { class: 'num', title: `Share of the ${noun} that this sensor sees` }, 'Sees'),
    element('span', { class: 'num', title: `Share of the ${noun} that no other active sensor sees` }, 'Only it'), element('span')));
  host.classList.toggle('long', sensors.some(({ name }) => name.length > 5)); // names need the bars' room
  sensors.forEach((sensor, s) => {
    const box = element('input', { type: 'checkbox', checked: true, 'aria-label': `${sensor.name} on`, change: () => setSensor(s, box.checked) });
    const name = element('button', { type: 'button', class: 'name', title: `${sensor.name}: only what it sees`,
      click: () => { state.kept = state.kept === s ? -1 : s; setFocus(state.kept); showState(models[state.model]); } },
    element('b', {}, sensor.name), kinds > 1 ? element('small', {}, sensor.kind) : null);
    const share = element('span', { class: 'num' }), alone = element('span', { class: 'num' }), gauge = bar(sensor.color);
    const eye = element('button', { type: 'button', class: 'eye', 'aria-label': `Look through ${sensor.name}`, title: `Look through ${sensor.name}`, click: () => lookThrough(s) }, eyeIcon());
    const node = element('div', { class: 'row', style: { '--color': sensor.color },
      pointerenter: (event) => event.pointerType === 'mouse' && setFocus(s),
      pointerleave: () => setFocus(state.kept) }, box, name, gauge.node, share, alone, eye);
    host.append(node);
    rows.push({ node, box, name, share, alone, gauge });
    const label = element('button', { type: 'button', class: 'label', tabindex: -1, style: { '--color': sensor.color }, title: `Look through ${sensor.name}`, click: () => lookThrough(s) }, sensor.name);
    byId('labels').append(label);
    labels.push(label);
  });
}

function eyeIcon() {
  return element('svg:svg', { viewBox: '0 0 20 20', width: 18, height: 18, 'aria-hidden': 'true' },
    element('svg:path', { d: 'M1.8 10S4.8 4.6 10 4.6 18.2 10 18.2 10 15.2 15.4 10 15.4 1.8 10 1.8 10Z', fill: 'none', stroke: 'currentColor', 'stroke-width': 1.5 }),
    element('svg:circle', { cx: 10, cy: 10, r: 2.6, fill: 'currentColor' }));
}

function buildToggles() {
  const add = (name, text) => {
    const box = element('input', { type: 'checkbox', change: () => show(name, box.checked) });
    byId('show').append(element('label', {}, box, text));
    toggles[name] = box;
  };
  add('frusta', 'Whole frusta');
  if (study.obstacles.length) add('obstacles', 'Obstacles');
  add('labels', 'Labels');
  add('edges', 'Mesh edges');
  add('cut', 'See through back faces');
}

// ---------------------------------------------------------------- numbers and legend

function showNumbers(mesh) {
  const { exactly, seen, alone, unseenArea, all } = covered, parts = mesh.pieceOf ? 'pieces' : 'faces';
  const share = (n) => percent(n / all), twice = exactly.slice(2).reduce((a, b) => a + b, 0);
  const amount = (n) => (byArea ? `${area(n, study.unit, n > all / 1000 ? all : n)} of ${area(all, study.unit)}` : `${number(n, 0)} of ${number(all, 0)} faces`);
  const ofArea = byArea ? '' : `, ${percent(unseenArea / mesh.area)} of the area`;
  const tile = (value, text, title, name) => element('div', { class: name, title }, element('b', {}, value), element('span', {}, text));
  byId('stats').replaceChildren(
    tile(share(all - exactly[0]), byArea ? 'area seen' : 'seen', `${amount(all - exactly[0])} are seen by at least one sensor`),
    tile(share(twice), 'by two or more', `${amount(twice)} are seen by at least two sensors`),
    tile(share(exactly[0]), 'unseen', byArea ? amount(exactly[0]) : `${number(exactly[0], 0)} faces, ${area(unseenArea, study.unit)}${ofArea}`, 'unseen'),
    element('p', { class: 'note' }, `${amount(exactly[0])} unseen${ofArea}` +
      (state.on.every(Boolean) ? '' : `, with ${state.on.filter(Boolean).length} of ${sensors.length} sensors`)));
  byId('stats').classList.toggle('tight', [...byId('stats').querySelectorAll('b')].some((b) => b.textContent.length > 7)); // "> 99.9 %"
  const most = Math.max(...seen) || 1; // bars compare sensors, so the longest is full
  rows.forEach((row, s) => {
    row.box.checked = state.on[s];
    row.node.classList.toggle('off', !state.on[s]);
    row.share.textContent = share(seen[s]);
    row.alone.textContent = state.on[s] ? share(alone[s]) : '–';
    row.gauge.set(seen[s] / most, state.on[s] ? alone[s] / most : 0);
    labels[s].classList.toggle('off', !state.on[s]);
  });
  byId('gaps').replaceChildren(element('h2', {}, 'Largest gaps'), ...(covered.gaps.length
    ? covered.gaps.map((gap, i) => element('button', { type: 'button', title: `${number(gap.nFaces, 0)} connected ${parts} that nobody sees`, click: () => goToGap(gap) },
      element('b', {}, String(i + 1)), area(gap.area, study.unit, covered.gaps.at(-1).area)))
    : [element('p', { class: 'note' }, 'None: every face is seen.')]));
}

/** What depends on the state but not on the counts. */
function showState(mesh) {
  rows.forEach((row, s) => {
    row.node.classList.toggle('focus', state.focus === s);
    row.name.setAttribute('aria-pressed', state.kept === s);
  });
  for (const [name, box] of Object.entries(toggles)) box.checked = state[name];
  markMode(state.mode);
  markModel?.();
  showLegend();
}

function showLegend() {
  const item = (color, text, name = '') => element('span', { class: 'item' }, element('i', { class: `chip ${name}`, style: { '--color': color } }), text);
  const { exactly, all } = covered, share = (n) => percent(n / all), { unseen, seen, overlap, obstacle } = study.colors;
  const nobody = item(css(unseen), `seen by nobody ${share(exactly[0])}`, 'striped');
  let items;
  if (state.focus >= 0) {
    const sensor = sensors[state.focus];
    items = [item(sensor.color, `seen by ${sensor.name} ${share(covered.seen[state.focus])}`), item(css(study.colors.dim), 'not seen by it')];
    if (state.mode === 'unseen') items.push(nobody);
  } else if (state.mode === 'overlap') {
    const last = Math.max(exactly.findLastIndex((n) => n > 0), 1);
    items = [element('span', { class: 'item head' }, 'Seen by'), item(css(unseen), `0  ${share(exactly[0])}`, 'striped')];
    for (let k = 1; k <= last; k++) items.push(item(css(overlap[k]), `${k}  ${share(exactly[k])}`));
    items.push(element('span', { class: 'item head' }, 'sensors'));
  } else if (state.mode === 'unseen') {
    items = [nobody, item(css(seen), `seen ${share(all - exactly[0])}`)];
    if (exactly[0] && state.through < 0) items.push(item(css(unseen), 'unseen, behind what is seen', 'veiled'));
  }
  else items = [element('span', { class: 'item head how' }, 'Colour: the sensor that sees the face most squarely'), nobody];
  if (study.obstacles.length && state.obstacles) items.push(item(css(obstacle), state.bared ? 'obstacle, faded' : 'obstacle', state.bared ? 'veiled' : ''));
  byId('legend').replaceChildren(...items);
}

function showThrough() {
  const on = state.through >= 0, sensor = sensors[state.through];
  byId('through').hidden = byId('frame').hidden = !on;
  document.body.classList.toggle('looking', on);
  hideReadout();
  if (!on) return;
  markView('');
  byId('through-name').textContent = sensor.name;
  byId('through-dot').style.setProperty('--color', sensor.color);
  byId('through-facts').textContent = throughWords(sensor);
  byId('back').focus({ preventScroll: true });
}

/** What one looks through: opening, range, and what of it a pinhole's picture cannot show. */
function throughWords(sensor) {
  const angle = (t) => number(degrees(2 * Math.atan(t)), 1), pinhole = `${sensor.tan_half.map(angle).join(' × ')}°`;
  const reach = `${number(sensor.min_distance)} to ${number(sensor.max_distance)} ${study.unit}${sensor.distance === 'range' ? ' from its centre' : ''}`;
  if (sensor.lens === 'pinhole') return `${pinhole}, ${reach}`;
  const own = sensor.opening.map((a) => number(a, 1)).join(' × ');
  return `${own}° ${sensor.words}, ${reach}; drawn without distortion, ${pinhole}`;
}

// ---------------------------------------------------------------- overlays that follow the camera

function placeLabels(shot) {
  const shown = state.labels && state.through < 0, placed = [];
  const spots = sensors.map((sensor, s) => ({ s, ...camera.project(add(sensor.center, shot.up, glyphSize * 0.8), shot.worldToClip) }));
  for (const { s, x, y, depth } of spots.sort((a, b) => b.y - a.y)) { // lowest first, the others give way upwards
    const label = labels[s];
    label.hidden = !shown || depth <= 0;
    if (label.hidden) continue;
    const wide = label.offsetWidth + 4;
    let top = y;
    for (const other of placed) if (Math.abs(other.x - x) < (other.wide + wide) / 2 && Math.abs(other.top - top) < 23) top = other.top - 23;
    placed.push({ x, top, wide });
    label.style.transform = `translate(${x.toFixed(1)}px, ${top.toFixed(1)}px) translate(-50%, -100%)`;
  }
  if (state.through >= 0) {
    const box = camera.frame(sensors[state.through]);
    for (const side of ['left', 'top', 'width', 'height']) byId('frame').style[side] = `${box[side]}px`;
    byId('frame').style.opacity = move ? 0 : 1;
  }
}

function placeScale(shot) {
  const perUnit = camera.height / (2 * camera.state.h), length = niceBelow(150 / perUnit);
  byId('scale').firstElementChild.style.width = `${length * perUnit}px`;
  byId('scale').lastElementChild.textContent = `${number(length, 4)} ${study.unit}`;
  const axes = ['X', 'Y', 'Z'].map((name, i) => {
    const axis = [0, 0, 0];
    axis[i] = 1;
    return { name, x: 25 * dot(axis, shot.right), y: -25 * dot(axis, shot.up), depth: dot(axis, shot.direction) };
  }).sort((a, b) => b.depth - a.depth);
  byId('triad').replaceChildren(...axes.flatMap(({ name, x, y }) => [
    element('svg:line', { x1: 0, y1: 0, x2: x, y2: y, class: name }),
    element('svg:text', { x: x * 1.36, y: y * 1.36 + 4, class: name }, name)]));
}

// ---------------------------------------------------------------- reading a face

/** What every sensor makes of a face: sees, the distance it measures, incidence in degrees, or why not. */
function readFace(mesh, face) {
  return sensors.map((sensor, s) => {
    const view = faceSeenFrom(mesh, face, sensor, study.incidence), sees = Boolean(mesh.sees(s, face));
    return { name: sensor.name, on: state.on[s], sees, distance: view.distance, incidence: degrees(Math.acos(clamp(view.cosine, -1, 1))),
      why: sees ? '' : study.refusals[mesh.refusal(s, face)] ?? 'not seen' };
  });
}

const kindOf = ({ kind, second }) => (second ? `${kind}, with ${second.role}` : kind);

/** Decimals that tell a thousandth of the scene. */
const decimals = () => clamp(Math.ceil(2.5 - Math.log10(camera.sphere.radius)), 0, 9);

function showReadout(hit, x, y) {
  const node = byId('readout'), narrow = camera.width < 640;
  if (hit.kind === 'model') {
    const mesh = models[state.model], readings = readFace(mesh, hit.face);
    const centroid = [0, 1, 2].map((j) => number(mesh.centroids[3 * hit.face + j] + study.origin[j], decimals())).join(', ');
    const line = (r, s) => element('tr', { class: r.sees && r.on ? '' : 'no', style: { '--color': sensors[s].color } },
      element('th', { scope: 'row' }, element('i', { class: 'dot' }), r.name),
      r.sees ? [element('td', {}, `${number(r.distance, decimals(), decimals())} ${study.unit}`), element('td', {}, `${r.incidence.toFixed(1)}°`)]
        : element('td', { colspan: 2 }, r.why), r.on ? null : element('td', {}, 'off'));
    const order = readings.map((_, s) => s).sort((a, b) => readings[b].sees - readings[a].sees);
    const seen = readings.filter((r) => r.sees && r.on).length;
    const one = state.focus, quality = qualityWords(mesh, hit.face, one >= 0 ? [one] : order.filter((s) => readings[s].on));
    node.replaceChildren(...[
      element('p', {}, element('b', {}, seen ? `Seen by ${seen} of ${sensors.length}` : 'Seen by nobody'), element('span', {}, mesh.pieceOf ? `piece of face ${number(mesh.pieceOf[hit.face], 0)}` : `face ${number(hit.face, 0)}`)),
      element('table', {}, element('thead', {}, element('tr', {}, element('th', {}, 'Sensor'), element('th', {}, 'Distance'), element('th', {}, 'Incidence'))),
        element('tbody', {}, order.slice(0, narrow ? 4 : 12).map((s) => line(readings[s], s)))),
      quality ? element('p', { class: 'note quality' }, one >= 0 ? `${sensors[one].name}: ${quality}` : `${seen > 1 ? 'At best ' : ''}${quality}`) : null,
      element('p', { class: 'note' }, `at ${centroid} ${study.unit}, ${area(mesh.areas[hit.face], study.unit)}`)].filter(Boolean));
  } else if (hit.kind === 'sensor') {
    node.replaceChildren(element('p', {}, element('b', {}, sensors[hit.sensor].name), element('span', {}, kindOf(sensors[hit.sensor]))), element('p', { class: 'note' }, 'Click to look through it'));
  } else node.replaceChildren(element('p', {}, element('b', {}, hit.name), element('span', {}, 'obstacle')));
  node.hidden = false;
  const { offsetWidth: w, offsetHeight: h } = node;
  if (narrow) { // in the half of the stage that was not tapped
    node.style.left = '8px';
    node.style.top = `${y < camera.height / 2 ? camera.height - h - 8 : 8}px`;
    mark(hit.kind === 'model' ? hit.face : -1);
    return;
  }
  // Beside the pointer, inside the stage.
  node.style.left = `${clamp(x + 18 + w > camera.width ? x - w - 18 : x + 18, 8, Math.max(8, camera.width - w - 8))}px`;
  node.style.top = `${clamp(y - h / 2, 8, Math.max(8, camera.height - h - 8))}px`;
  mark(hit.kind === 'model' ? hit.face : -1);
}

function mark(face) {
  if (marked === face) return;
  marked = face;
  if (slow) return; // a heavy scene is not drawn again for a highlight
  const fresh = idsFresh;
  redraw();
  idsFresh = fresh; // only a colour changed
}

function hideReadout() {
  byId('readout').hidden = true;
  canvas.style.cursor = '';
  mark(-1);
}

function readAt(x, y) {
  const hit = pickAt(x, y);
  if (hit) showReadout(hit, x, y);
  else hideReadout();
  canvas.style.cursor = hit?.kind === 'sensor' ? 'pointer' : '';
  return hit;
}

function hover() {
  hover.queued = false;
  if (!move) readAt(...hover.at);
}

function tap(x, y) {
  const hit = readAt(x, y);
  if (hit?.kind === 'sensor') lookThrough(hit.sensor);
}

function centerOn(x, y) {
  const hit = pickAt(x, y);
  if (hit?.kind !== 'model') return;
  const target = [...models[state.model].centroids.subarray(3 * hit.face, 3 * hit.face + 3)];
  go({ ...camera.state, target, h: camera.state.h * 0.6 });
}

// ---------------------------------------------------------------- keys and address

function toggleKeys() {
  byId('keys').hidden = !byId('keys').hidden;
  (byId('keys').hidden ? canvas : byId('keys-close')).focus();
}

function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || (event.target.matches('select') && event.key !== 'Escape')) return;
  const { key, shiftKey } = event;
  if (document.activeElement === canvas) {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[key];
    if (step) {
      event.preventDefault();
      unlessThrough(() => (shiftKey ? camera.pan(-40 * step[0], -40 * step[1]) : (camera.turn(-0.12 * step[0], -0.12 * step[1]), markView(''))));
      return;
    }
    if (key === 'Enter') { readAt(camera.width / 2, camera.height / 2); return; }
  }
  const actions = {
    '+': () => unlessThrough(() => camera.zoom(0.85)), '=': () => unlessThrough(() => camera.zoom(0.85)),
    '-': () => unlessThrough(() => camera.zoom(1 / 0.85)),
    1: () => setView('3D'), 2: () => setView('Top'), 3: () => setView('Front'), 4: () => setView('Side'),
    s: () => setMode('sensor'), o: () => setMode('overlap'), u: () => setMode('unseen'),
    n: () => lookThrough(state.through + 1), p: () => lookThrough(state.through < 0 ? -1 : state.through - 1),
    '[': () => setModel(state.model - 1), ']': () => setModel(state.model + 1),
    f: () => show('frusta', !state.frusta), b: () => show('obstacles', !state.obstacles),
    l: () => show('labels', !state.labels), m: () => show('edges', !state.edges),
    '?': toggleKeys,
    Escape: () => { if (!byId('keys').hidden) toggleKeys(); else if (state.through >= 0) leaveSensor(); else { state.kept = -1; setFocus(-1); } },
  };
  actions[key.length === 1 ? key.toLowerCase() : key]?.();
}

/** A link may say where to begin: #mode=unseen&model=arm2&view=Top&through=A1&frusta=1 */
function fromHash() {
  const wanted = new URLSearchParams(location.hash.slice(1)), has = (name) => wanted.get(name);
  const model = models.findIndex((mesh) => mesh.name === has('model'));
  const sensor = sensors.findIndex((s) => s.name === has('through'));
  if (model > 0) setModel(model);
  if (MODES.some(([mode]) => mode === has('mode'))) setMode(has('mode'));
  if (STANDARD[has('view')]) setView(has('view'), 0);
  for (const name of Object.keys(toggles)) if (has(name)) show(name, has(name) === '1');
  if (sensor >= 0) lookThrough(sensor, 0);
}
