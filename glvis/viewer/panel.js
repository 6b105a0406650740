// The page beside the picture: elements, tables, the convergence plot.

/** An element with attributes (functions become listeners) and children. */
function element(tag, attributes = {}, ...children) {
  const node = tag.startsWith('svg:')
    ? document.createElementNS('http://www.w3.org/2000/svg', tag.slice(4)) : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === 'function') node.addEventListener(name, value);
    else if (name === 'style') Object.entries(value).forEach(([k, v]) => node.style.setProperty(k, v));
    else if (value === true) node.setAttribute(name, '');
    else if (value !== false && value !== undefined) node.setAttribute(name, value);
  }
  node.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return node;
}

const byId = (id) => document.getElementById(id);
const css = ([r, g, b]) => `rgb(${r} ${g} ${b})`;

/** Buttons of which one is on: [value, text, title]; returns a function that sets it. */
function choice(host, options, onChoose, role = 'radio') {
  const buttons = options.map(([value, text, title]) => element('button',
    { type: 'button', role: role === 'radio' ? 'radio' : false, title, click: () => onChoose(value) }, text));
  host.append(...buttons);
  host.addEventListener('keydown', (event) => {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    const at = buttons.indexOf(document.activeElement);
    if (!step || at < 0 || role !== 'radio') return;
    event.preventDefault();
    const next = (at + step + buttons.length) % buttons.length;
    buttons[next].focus();
    onChoose(options[next][0]);
  });
  return (value) => buttons.forEach((button, i) => {
    const on = options[i][0] === value;
    button.setAttribute(role === 'radio' ? 'aria-checked' : 'aria-pressed', on);
    if (role === 'radio') button.tabIndex = on ? 0 : -1;
  });
}

function section(title, ...children) {
  return element('section', {}, element('h2', {}, title), ...children);
}

function table({ title, note, header, rows }) {
  // One number of decimals a column, so that they stand under each other; shares have one, as everywhere.
  const digits = header.map((name, c) => {
    const values = rows.map((row) => row[c]).filter((value) => typeof value === 'number');
    if (name.includes('%')) return 1;
    const largest = Math.max(...values.map(Math.abs), 0);
    return values.every(Number.isInteger) ? 0 : largest >= 1000 ? 0 : largest >= 100 ? 1 : 2;
  });
  const show = (value, c) => (typeof value === 'number' ? number(value, digits[c], digits[c]) : String(value ?? ''));
  const numeric = header.map((_, c) => rows.every((row) => /^[-−–+]?[\d,.\s]*\s?[%°]?$/.test(show(row[c], c))));
  const cell = (tag, value, c) => element(tag, { class: numeric[c] ? 'num' : undefined, scope: tag === 'th' ? 'col' : undefined },
    tag === 'th' ? value : show(value, c));
  return section(title,
    note ? element('p', { class: 'note' }, note) : null,
    element('div', { class: 'scroll', tabindex: 0, role: 'region', 'aria-label': title }, element('table', {},
      element('thead', {}, element('tr', {}, header.map((text, c) => cell('th', text, c)))),
      element('tbody', {}, rows.map((row) => element('tr', {}, row.map((value, c) => cell('td', value, c))))))));
}

/** Best and mean value over the iterations, as SVG. */
function convergence({ iteration, best, mean }) {
  const W = 340, H = 190, left = 44, right = 10, top = 12, bottom = 34;
  const finite = [...best, ...mean].filter(Number.isFinite);
  if (iteration.length < 2 || !finite.length) return null;
  const lowest = Math.min(...finite), highest = Math.max(...finite), span = highest - lowest || Math.abs(highest) || 1;
  const step = niceBelow(span / 3), y0 = Math.floor(lowest / step) * step, y1 = Math.max(Math.ceil(highest / step) * step, y0 + step);
  const x0 = iteration[0], x1 = iteration.at(-1), xStep = Math.max(1, niceBelow((x1 - x0) / 3));
  const x = (v) => left + (v - x0) / (x1 - x0) * (W - left - right);
  const y = (v) => H - bottom - (v - y0) / (y1 - y0) * (H - top - bottom);
  const line = (values, name) => {
    let pen = 'M';
    const d = values.map((v, i) => {
      if (!Number.isFinite(v)) { pen = 'M'; return ''; }
      const part = `${pen}${x(iteration[i]).toFixed(1)} ${y(v).toFixed(1)}`;
      pen = 'L';
      return part;
    }).join('');
    return element('svg:path', { d, class: name });
  };
  const text = (value, at, name) => element('svg:text', { x: at[0], y: at[1], class: name }, value);
  const ticks = [];
  for (let v = y0; v <= y1 + step / 2; v += step)
    ticks.push(element('svg:line', { x1: left, x2: W - right, y1: y(v), y2: y(v), class: 'grid' }), text(number(v, 3), [left - 6, y(v) + 3.5], 'y'));
  for (let v = Math.ceil(x0 / xStep) * xStep; v <= x1; v += xStep) ticks.push(text(number(v), [x(v), H - bottom + 16], 'x'));
  return section('Convergence',
    element('svg:svg', { viewBox: `0 0 ${W} ${H}`, class: 'plot', role: 'img',
      'aria-label': `Objective over ${iteration.length} iterations: the best rises from ${number(best[0], 3)} to ${number(best.at(-1), 3)}.` },
    ...ticks, line(mean, 'mean'), line(best, 'best'),
    text('Iteration', [(left + W - right) / 2, H - 3], 'x'),
    Number.isFinite(best.at(-1)) ? element('svg:circle', { cx: x(x1), cy: y(best.at(-1)), r: 3, class: 'end' }) : null),
    element('p', { class: 'key' }, element('span', { class: 'best' }, `Best of the swarm, ${number(best.at(-1), 3)} at the end`),
      element('span', { class: 'mean' }, 'Mean of the swarm')));
}

/** Lines of text; indented ones belong to the line above. */
function mounting(lines) {
  const indent = (line = '') => line.length - line.trimStart().length;
  const node = section('Mounting', lines.map((line, i) => element('p', {
    class: !indent(line) && indent(lines[i + 1]) ? 'head' : undefined, style: { 'padding-left': `${indent(line) * 4}px` } }, line.trim())));
  node.classList.add('mounting');
  return node;
}

/** Sections under the controls: tables, convergence, mounting, facts. */
function details(study) {
  const nodes = study.tables.map(table);
  if (study.trace) nodes.push(convergence(study.trace));
  if (study.mounting.length) nodes.push(mounting(study.mounting));
  if (study.facts.length)
    nodes.push(section('About this run', element('dl', { class: 'facts' },
      study.facts.flatMap(([key, value]) => [element('dt', {}, key), element('dd', {}, value)]))));
  return nodes.filter(Boolean);
}

/** A share as a bar: what the sensor sees, the part that only it sees drawn solid. */
function bar(color) {
  const whole = element('i', { class: 'whole' }), solid = element('i', { class: 'alone' });
  const node = element('span', { class: 'bar', style: { '--color': color }, 'aria-hidden': 'true' }, whole, solid);
  return { node, set(share, alone) { whole.style.width = `${100 * share}%`; solid.style.width = `${100 * alone}%`; } };
}
