// Vectors are arrays of three numbers; matrices are column-major, as WebGL takes them.

const add = (a, b, k = 1) => [a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]];
const sub = (a, b) => add(a, b, -1);
const scaled = (a, k) => [a[0] * k, a[1] * k, a[2] * k];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const norm = (a) => Math.hypot(a[0], a[1], a[2]);
const unit = (a) => scaled(a, 1 / norm(a));
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
const mix = (a, b, t) => a + (b - a) * t;
const degrees = (radians) => radians * 180 / Math.PI;

/** Product a b of two 4x4 matrices. */
function multiply(a, b) {
  const out = new Float64Array(16);
  for (let c = 0; c < 4; c++)
    for (let r = 0; r < 4; r++)
      for (let k = 0; k < 4; k++) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
  return out;
}

/** Camera to clip space; the tangents are those of the half angles. */
function perspective(tanX, tanY, near, far) {
  const out = new Float64Array(16);
  out[0] = 1 / tanX;
  out[5] = 1 / tanY;
  out[10] = -(far + near) / (far - near);
  out[11] = -1;
  out[14] = -2 * far * near / (far - near);
  return out;
}

/** World to camera for an eye with the given unit axes; the camera looks along -z. */
function worldToCamera(eye, right, up, direction) {
  const back = scaled(direction, -1);
  const rows = [right, up, back];
  const out = new Float64Array(16);
  rows.forEach((row, r) => {
    for (let c = 0; c < 3; c++) out[4 * c + r] = row[c];
    out[12 + r] = -dot(row, eye);
  });
  out[15] = 1;
  return out;
}

/** Round to 1, 2 or 5 times a power of ten, downwards. */
function niceBelow(x) {
  const power = 10 ** Math.floor(Math.log10(x));
  return (x >= 5 * power ? 5 : x >= 2 * power ? 2 : 1) * power;
}

/** A number for readers: about four significant digits, thousands apart. */
function number(x, digits = Math.abs(x) >= 1000 ? 0 : Math.abs(x) >= 100 ? 1 : 2, fewest = 0) {
  if (!Number.isFinite(x)) return '–';
  return x.toLocaleString('en-US', { minimumFractionDigits: fewest, maximumFractionDigits: digits }).replace('-', '−');
}

/** A number with three significant digits, or all of those before the point; never an exponent. */
function significant(x) {
  if (!x) return '0';
  const digits = clamp(2 - Math.floor(Math.log10(Math.abs(x) * (1 + 1e-12))), 0, 12);
  return number(x, digits, digits);
}

/** A number with two significant digits, or all of those before the point. */
const twoDigits = (x) => number(x, x > 0 ? clamp(1 - Math.floor(Math.log10(x * (1 + 1e-12))), 0, 12) : 0);

const METRIC = { mm: 1, cm: 10, m: 1000 }; // in millimetres

/** An area for readers, in the metric unit that suits `like`: 0.00167 m² are 1,670 mm². */
function area(x, lengthUnit, like = x) {
  const size = METRIC[lengthUnit], inMm = size ** 2 * like;
  const unit = !size ? lengthUnit : inMm < 1e4 ? 'mm' : inMm < 1e6 ? 'cm' : 'm';
  return `${significant(size ? x * (size / METRIC[unit]) ** 2 : x)} ${unit === 'inch' ? 'in' : unit}²`;
}

/** A share for readers; nothing is rounded to none or to all. */
function percent(x) {
  if (x > 0 && x < 0.0005) return '< 0.1 %';
  if (x < 1 && x >= 0.9995) return '> 99.9 %';
  return `${(100 * x).toFixed(1)} %`;
}
