// Meshes out of the page's text, and what follows from their shape.
// page.py packs: base64 of one deflate stream; in it each array at `offset` of the header.

/** The bytes of all meshes: base64 text in, inflated. */
async function unpack(text) {
  if (typeof DecompressionStream === 'undefined')
    throw new Error('This browser is too old to unpack the scene (it lacks DecompressionStream). ' +
      'Chrome 80, Firefox 113, Safari 16.4 or newer can.');
  const raw = atob(text.trim());
  const packed = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) packed[i] = raw.charCodeAt(i);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Put byte planes (all first bytes, all second bytes, ...) back into n 4-byte words. */
function joinPlanes(bytes, offset, n) {
  const out = new Uint8Array(4 * n);
  for (let k = 0; k < 4; k++)
    for (let i = 0, from = offset + k * n; i < n; i++) out[4 * i + k] = bytes[from + i];
  return out.buffer;
}

/** A mesh of the header: vertices (3V), faces (3F), per sensor one bit a face, the file's face of each (F). */
function readMesh(bytes, entry) {
  const vertices = new Float32Array(joinPlanes(bytes, entry.vertices, 3 * entry.nVertices));
  const faces = new Uint32Array(joinPlanes(bytes, entry.faces, 3 * entry.nFaces));
  for (let i = 0, previous = 0; i < faces.length; i++) { // differences, sign in the lowest bit
    previous += (faces[i] >>> 1) ^ -(faces[i] & 1);
    faces[i] = previous;
  }
  const stride = (entry.nFaces + 7) >> 3;
  const bits = entry.visible === undefined ? null : bytes.subarray(entry.visible);
  const pieceOf = entry.pieceOf === undefined ? null : new Uint32Array(joinPlanes(bytes, entry.pieceOf, entry.nFaces));
  pieceOf?.forEach((step, i) => { if (i) pieceOf[i] = pieceOf[i - 1] + step; });
  return {
    name: entry.name, nFaces: entry.nFaces, vertices, faces, pieceOf,
    sees: (sensor, face) => (bits[sensor * stride + (face >> 3)] >> (face & 7)) & 1,
    qualities: (entry.qualities ?? []).map(({ label, unit, low, high, steps }) => ({ label, unit, // NaN where there is none
      of: (sensor, face) => {
        const step = bytes[steps + sensor * entry.nFaces + face];
        return step ? low * (high / low) ** ((step - 1) / 254) : NaN;
      } })),
    refusal: (sensor, face) => (entry.refusals === undefined ? -1 : bytes[entry.refusals + sensor * entry.nFaces + face]),
  };
}

/** Add face normals (3F, unit, zero without area), centroids (3F), areas (F) and their sum. */
function measure(mesh) {
  const { vertices: v, faces: f, nFaces } = mesh;
  const normals = new Float32Array(3 * nFaces);
  const centroids = new Float32Array(3 * nFaces);
  const areas = new Float32Array(nFaces);
  let total = 0;
  for (let i = 0, k = 0; i < nFaces; i++, k += 3) {
    const a = 3 * f[k], b = 3 * f[k + 1], c = 3 * f[k + 2];
    const ux = v[b] - v[a], uy = v[b + 1] - v[a + 1], uz = v[b + 2] - v[a + 2];
    const wx = v[c] - v[a], wy = v[c + 1] - v[a + 1], wz = v[c + 2] - v[a + 2];
    const nx = uy * wz - uz * wy, ny = uz * wx - ux * wz, nz = ux * wy - uy * wx;
    const length = Math.sqrt(nx * nx + ny * ny + nz * nz);
    const k1 = length > 0 ? 1 / length : 0;
    normals[k] = nx * k1; normals[k + 1] = ny * k1; normals[k + 2] = nz * k1;
    for (let j = 0; j < 3; j++) centroids[k + j] = (v[a + j] + v[b + j] + v[c + j]) / 3;
    areas[i] = length / 2;
    total += length / 2;
  }
  return Object.assign(mesh, { normals, centroids, areas, area: total });
}

const CREASE = Math.cos(40 * Math.PI / 180); // sharper edges than this stay edges

/**
 * One position (3) and one packed normal a corner, face after face, for the vertex buffers.
 * The normal is the mean of the faces around the vertex that turn less than the crease angle:
 * round things look round, boxes keep their edges.
 */
function corners(mesh) {
  const { vertices, faces, normals, areas } = mesh;
  const n = faces.length;
  const start = new Uint32Array(vertices.length / 3 + 1); // faces around vertex i begin here
  for (let i = 0; i < n; i++) start[faces[i] + 1]++;
  for (let i = 1; i < start.length; i++) start[i] += start[i - 1];
  const around = new Uint32Array(n);
  const next = start.slice();
  for (let i = 0; i < n; i++) around[next[faces[i]]++] = (i / 3) | 0;

  const positions = new Float32Array(3 * n);
  const packed = new Uint32Array(n);
  for (let i = 0; i < n; i++) {
    const vertex = faces[i], face = (i / 3) | 0;
    const fx = normals[3 * face], fy = normals[3 * face + 1], fz = normals[3 * face + 2];
    let x = 0, y = 0, z = 0;
    for (let j = start[vertex]; j < start[vertex + 1]; j++) {
      const other = around[j], gx = normals[3 * other], gy = normals[3 * other + 1], gz = normals[3 * other + 2];
      if (fx * gx + fy * gy + fz * gz < CREASE) continue;
      x += gx * areas[other]; y += gy * areas[other]; z += gz * areas[other];
    }
    const k = 511 / (Math.sqrt(x * x + y * y + z * z) || 1); // signed 10 bits each
    packed[i] = (Math.round(x * k) & 1023) | (Math.round(y * k) & 1023) << 10 | (Math.round(z * k) & 1023) << 20;
    for (let j = 0; j < 3; j++) positions[3 * i + j] = vertices[3 * vertex + j];
  }
  return { positions, packed };
}

/**
 * The mesh with one vertex a cell of a grid and only the faces that still span three cells;
 * `origin` says for each face which one of the full mesh it was.
 */
function coarsened({ vertices, faces }, cells = 96) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < vertices.length; i++) {
    low[i % 3] = Math.min(low[i % 3], vertices[i]);
    high[i % 3] = Math.max(high[i % 3], vertices[i]);
  }
  const size = Math.max(...sub(high, low)) / cells || 1, first = new Map();
  const kept = new Uint32Array(vertices.length / 3); // the first vertex in the cell of each
  for (let v = 0; v < kept.length; v++) {
    const [x, y, z] = [0, 1, 2].map((j) => Math.floor((vertices[3 * v + j] - low[j]) / size));
    const cell = (x * (cells + 1) + y) * (cells + 1) + z;
    if (!first.has(cell)) first.set(cell, v);
    kept[v] = first.get(cell);
  }
  const out = [], origin = [];
  for (let k = 0; k < faces.length; k += 3) {
    const a = kept[faces[k]], b = kept[faces[k + 1]], c = kept[faces[k + 2]];
    if (a === b || b === c || c === a) continue;
    out.push(a, b, c);
    origin.push(k / 3);
  }
  return measure({ vertices, faces: new Uint32Array(out), nFaces: origin.length, origin: new Uint32Array(origin) });
}

/** Several meshes as one (obstacles); `owner` says for each face which mesh it came from. */
function merged(meshes) {
  const nFaces = meshes.reduce((n, m) => n + m.nFaces, 0);
  const vertices = new Float32Array(meshes.reduce((n, m) => n + m.vertices.length, 0));
  const faces = new Uint32Array(3 * nFaces);
  const owner = new Uint32Array(nFaces);
  let v = 0, f = 0;
  meshes.forEach((mesh, i) => {
    vertices.set(mesh.vertices, v);
    owner.fill(i, f, f + mesh.nFaces);
    for (let k = 0; k < mesh.faces.length; k++) faces[3 * f + k] = mesh.faces[k] + v / 3;
    v += mesh.vertices.length;
    f += mesh.nFaces;
  });
  return measure({ vertices, faces, nFaces, owner });
}
