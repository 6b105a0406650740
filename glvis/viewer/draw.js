// WebGL2: meshes with a palette entry a face, wide lines, and the ID buffer under the pointer.

const PAINT_WIDTH = 2048; // texels a row of the paint texture
const STEPS_BACK = 8;     // of the depth buffer, by which backs of faces recede: more than rounding takes

function compile(gl, name, attributes) {
  const program = gl.createProgram();
  for (const [kind, stage] of [[gl.VERTEX_SHADER, 'vert'], [gl.FRAGMENT_SHADER, 'frag']]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, SHADERS[`viewer_${name}.${stage}.glsl`]);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS))
      throw new Error(`viewer_${name}.${stage}.glsl: ${gl.getShaderInfoLog(shader)}`);
    gl.attachShader(program, shader);
  }
  attributes.forEach((attribute, i) => gl.bindAttribLocation(program, i, attribute));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS))
    throw new Error(`viewer_${name}: ${gl.getProgramInfoLog(program)}`);
  const uniforms = {};
  for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
    const uniform = gl.getActiveUniform(program, i).name;
    uniforms[uniform] = gl.getUniformLocation(program, uniform);
  }
  return { program, uniforms };
}

/** Everything that touches the GPU; the rest of the page hands over arrays and matrices. */
class Painter {
  constructor(canvas) {
    const gl = canvas.getContext('webgl2', { antialias: true, alpha: true, stencil: true, powerPreference: 'high-performance' });
    if (!gl) throw new Error('This browser offers no WebGL 2, so the scene cannot be drawn. The tables below are complete.');
    this.gl = gl;
    this.mesh = compile(gl, 'mesh', ['position', 'normal']);
    this.id = compile(gl, 'id', ['position']);
    this.line = compile(gl, 'line', ['from', 'to', 'tint', 'width']);
    this.palette = this.texture();
    this.lineBuffer = gl.createBuffer();
    this.lineArray = gl.createVertexArray();
    this.lineCount = 0;
    gl.bindVertexArray(this.lineArray);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.lineBuffer);
    [[0, 3, gl.FLOAT, false, 0], [1, 3, gl.FLOAT, false, 12], [2, 4, gl.UNSIGNED_BYTE, true, 24], [3, 1, gl.FLOAT, false, 28]]
      .forEach(([index, size, type, normalized, offset]) => {
        gl.enableVertexAttribArray(index);
        gl.vertexAttribPointer(index, size, type, normalized, 32, offset);
        gl.vertexAttribDivisor(index, 1);
      });
    this.target = null; // the ID buffer, made when first asked for
  }

  texture() {
    const { gl } = this, texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    return texture;
  }

  setPalette(colors) {
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, this.palette);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, colors.length, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE,
      new Uint8Array(colors.flatMap((c) => [...c, 255])));
  }

  /** Upload corners (see mesh.js); colours follow by setPaint. */
  upload({ positions, packed }) {
    const { gl } = this, array = gl.createVertexArray(), buffers = [gl.createBuffer(), gl.createBuffer()];
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers[0]);
    gl.bufferData(gl.ARRAY_BUFFER, positions, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers[1]);
    gl.bufferData(gl.ARRAY_BUFFER, packed, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 4, gl.INT_2_10_10_10_REV, true, 0, 0);
    return { array, buffers, paint: this.texture(), nFaces: packed.length / 3 };
  }

  setPaint(thing, entries) {
    const { gl } = this, rows = Math.ceil(entries.length / PAINT_WIDTH);
    const padded = new Uint16Array(rows * PAINT_WIDTH);
    padded.set(entries);
    gl.bindTexture(gl.TEXTURE_2D, thing.paint);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.R16UI, PAINT_WIDTH, rows, 0, gl.RED_INTEGER, gl.UNSIGNED_SHORT, padded);
  }

  release(thing) {
    const { gl } = this;
    gl.deleteVertexArray(thing.array);
    thing.buffers.forEach((buffer) => gl.deleteBuffer(buffer));
    gl.deleteTexture(thing.paint);
  }

  /** Segments: [from, to, [r, g, b], opacity, width]. */
  setLines(segments) {
    const { gl } = this, data = new ArrayBuffer(32 * segments.length);
    const floats = new Float32Array(data), bytes = new Uint8Array(data);
    segments.forEach(([from, to, color, opacity, width], i) => {
      floats.set([...from, ...to], 8 * i);
      bytes.set([...color, 255 * opacity], 32 * i + 24);
      floats[8 * i + 7] = width;
    });
    gl.bindBuffer(gl.ARRAY_BUFFER, this.lineBuffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
    this.lineCount = segments.length;
  }

  /** Draw the things with the camera of `shot`; see main.js for its fields. */
  draw(things, shot) {
    const { gl } = this, { uniforms } = this.mesh, { width, height } = gl.canvas;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.disable(gl.BLEND);
    gl.useProgram(this.mesh.program);
    gl.uniformMatrix4fv(uniforms.world_to_clip, false, shot.worldToClip);
    gl.uniform3fv(uniforms.eye, shot.eye);
    gl.uniform3fv(uniforms.up, shot.up);
    gl.uniform3fv(uniforms.key_light, shot.keyLight);
    gl.uniform1f(uniforms.pixel, shot.pixel);
    gl.uniform1i(uniforms.paint, 0);
    gl.uniform1i(uniforms.palette, 1);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.palette);
    gl.activeTexture(gl.TEXTURE0);
    const drawThing = (thing, ghost, veil = 1) => {
      gl.uniform1f(uniforms.ghost, ghost);
      gl.uniform1f(uniforms.veil, veil);
      gl.uniform1f(uniforms.edges, thing.edges ? 1 : 0);
      gl.uniform1i(uniforms.marked, thing.marked ?? -1);
      gl.bindTexture(gl.TEXTURE_2D, thing.paint);
      this.drawSides(thing);
    };
    for (const thing of things) if (!(thing.veil < 1)) drawThing(thing, 1);

    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    gl.enable(gl.STENCIL_TEST); // one layer of a veil a pixel, however many faces there are
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    gl.stencilFunc(gl.EQUAL, 0, 255);
    gl.depthFunc(gl.GREATER); // what hides unseen faces lets them shine through
    for (const thing of things) if (thing.ghost) drawThing(thing, 0.28);
    gl.depthFunc(gl.LEQUAL);
    gl.clear(gl.STENCIL_BUFFER_BIT);
    for (const thing of things) if (thing.veil < 1) drawThing(thing, 1, thing.veil);
    gl.disable(gl.STENCIL_TEST);
    gl.disable(gl.CULL_FACE);
    gl.useProgram(this.line.program);
    gl.uniformMatrix4fv(this.line.uniforms.world_to_clip, false, shot.worldToClip);
    gl.uniform2f(this.line.uniforms.viewport, width, height);
    gl.uniform1f(this.line.uniforms.pixel, shot.pixel);
    gl.bindVertexArray(this.lineArray);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.lineCount);
    gl.depthMask(true);
  }

  /** Draw a thing: of a sheet that is modelled from both sides the front shows, wherever one stands. */
  drawSides(thing) {
    const { gl } = this;
    gl.bindVertexArray(thing.array);
    gl.enable(gl.CULL_FACE);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    for (const [culled, back] of thing.cutAway ? [[gl.BACK, 0]] : [[gl.BACK, 0], [gl.FRONT, STEPS_BACK]]) {
      gl.cullFace(culled);
      gl.polygonOffset(0, back);
      gl.drawArrays(gl.TRIANGLES, 0, 3 * thing.nFaces);
    }
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.disable(gl.CULL_FACE);
  }

  /** Call back with the milliseconds that the GPU needs for what was asked of it until now. */
  timed(report) {
    const { gl } = this, start = performance.now(), fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    const poll = () => {
      if (gl.clientWaitSync(fence, 0, 0) === gl.TIMEOUT_EXPIRED) { setTimeout(poll, 10); return; }
      gl.deleteSync(fence);
      report(performance.now() - start);
    };
    setTimeout(poll, 0);
  }

  /** Draw IDs at CSS resolution: each thing counts from its `firstId`; 0 is nothing. */
  drawIds(things, worldToClip, width, height) {
    const { gl } = this;
    if (!this.target || this.target.width !== width || this.target.height !== height) {
      this.target ??= { frame: gl.createFramebuffer(), color: gl.createRenderbuffer(), depth: gl.createRenderbuffer() };
      Object.assign(this.target, { width, height });
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.target.frame);
      for (const [buffer, format, point] of [
        [this.target.color, gl.R32UI, gl.COLOR_ATTACHMENT0],
        [this.target.depth, gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT]]) {
        gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
        gl.renderbufferStorage(gl.RENDERBUFFER, format, width, height);
        gl.framebufferRenderbuffer(gl.FRAMEBUFFER, point, gl.RENDERBUFFER, buffer);
      }
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target.frame);
    gl.viewport(0, 0, width, height);
    gl.clearBufferuiv(gl.COLOR, 0, [0, 0, 0, 0]);
    gl.clearBufferfv(gl.DEPTH, 0, [1]);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LESS);
    gl.disable(gl.BLEND);
    gl.useProgram(this.id.program);
    gl.uniformMatrix4fv(this.id.uniforms.world_to_clip, false, worldToClip);
    for (const thing of things) {
      gl.uniform1ui(this.id.uniforms.first_id, thing.firstId);
      this.drawSides(thing);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** The ID at a CSS pixel counted from the top left. */
  idAt(x, y) {
    const { gl, target } = this, out = new Uint32Array(4);
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
    gl.readPixels(Math.floor(x), target.height - 1 - Math.floor(y), 1, 1, gl.RGBA_INTEGER, gl.UNSIGNED_INT, out);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return out[0];
  }
}
