// Surfels in 3-D: those that face the eye, sorted by distance and blended in linear light as Gaussians on their own planes.
(() => {
  const { data, fill, nameOf } = shared;
  const found = (name) => document.getElementById(name);
  if (!found("surfels")) return; // no cell keeps surfels
  const [leftSelect, rightSelect, shownSelect, said] = ["surfels-left", "surfels-right", "surfels-shown", "surfels-said"].map(found);
  const stages = [...document.querySelectorAll(".turnable")];
  const kept = data.runs.filter((run) => found(`surfels-${run.key}`));
  const unpacked = new Map();
  const BYTES = 26; // a surfel's, see page/surfels.py
  const FLOATS = 13; // centre, two tangents, colour, opacity
  const CORNER = 3; // standard deviations
  const FIELD = Math.tan((20 * Math.PI) / 180);
  const START = { turn: 0, tilt: 0, distance: 1 }; // as seen by the camera whose maps are kept
  let camera = { ...START };
  let asked = false;

  const VERTEX = `#version 300 es
    layout(location = 0) in vec2 corner;
    layout(location = 1) in vec3 centre;
    layout(location = 2) in vec3 first;
    layout(location = 3) in vec3 second;
    layout(location = 4) in vec4 colour;
    uniform mat4 projection;
    uniform vec3 eye;
    out vec2 place;
    flat out vec4 shade;
    const vec4 NOWHERE = vec4(2.0, 2.0, 2.0, 1.0);
    void main() {
      bool faces = dot(cross(first, second), eye - centre) > 0.0;
      place = corner;
      shade = colour;
      gl_Position = faces ? projection * vec4(centre + corner.x * first + corner.y * second, 1.0) : NOWHERE;
    }`;
  const FRAGMENT = `#version 300 es
    precision highp float;
    in vec2 place;
    flat in vec4 shade;
    out vec4 seen;
    void main() {
      float alpha = shade.a * exp(-0.5 * dot(place, place));
      if (alpha < 0.002) discard;
      seen = vec4(shade.rgb * alpha, alpha);
    }`;
  const WHOLE = `#version 300 es
    layout(location = 0) in vec2 corner;
    void main() { gl_Position = vec4(corner / ${CORNER.toFixed(1)}, 0.0, 1.0); }`;
  const ENCODE = `#version 300 es
    precision highp float;
    uniform sampler2D blended;
    uniform vec3 paper;
    out vec4 seen;
    void main() {
      vec4 found = texelFetch(blended, ivec2(gl_FragCoord.xy), 0);
      vec3 light = found.rgb + (1.0 - found.a) * paper;
      seen = vec4(mix(12.92 * light, 1.055 * pow(max(light, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, light)), 1.0);
    }`;

  const linear = (byte) => (byte / 255 <= 0.04045 ? byte / 255 / 12.92 : ((byte / 255 + 0.055) / 1.055) ** 2.4);

  function unpack(key) {
    if (unpacked.has(key)) return unpacked.get(key);
    const stored = JSON.parse(found(`surfels-${key}`).textContent);
    const view = new DataView(Uint8Array.from(atob(stored.surfels), (each) => each.charCodeAt(0)).buffer);
    const number = view.byteLength / BYTES;
    const model = { number, count: stored.count, geometry: new Float32Array(9 * number), shades: {} };
    for (const shown of ["radiance", "albedo", "normal", "roughness"]) model.shades[shown] = new Float32Array(4 * number);
    for (let each = 0; each < number; each += 1) {
      const at = each * BYTES;
      for (let axis = 0; axis < 3; axis += 1) model.geometry[9 * each + axis] = stored.low[axis] + stored.step[axis] * view.getUint16(at + 2 * axis, true);
      for (let part = 0; part < 6; part += 1) model.geometry[9 * each + 3 + part] = (stored.reach * view.getInt16(at + 6 + 2 * part, true)) / 32767;
      const [u, v] = [model.geometry.subarray(9 * each + 3, 9 * each + 6), model.geometry.subarray(9 * each + 6, 9 * each + 9)];
      const normal = unit(cross(u, v));
      const roughness = view.getUint8(at + 25) / 255;
      for (let channel = 0; channel < 3; channel += 1) {
        model.shades.radiance[4 * each + channel] = linear(view.getUint8(at + 19 + channel));
        model.shades.albedo[4 * each + channel] = linear(view.getUint8(at + 22 + channel));
        model.shades.normal[4 * each + channel] = linear(127.5 * (1 + normal[channel]));
        model.shades.roughness[4 * each + channel] = linear(255 * roughness);
      }
      for (const shade of Object.values(model.shades)) shade[4 * each + 3] = view.getUint8(at + 18) / 255;
    }
    const middle = stored.middle ?? [0, 1, 2].map((axis) => median(model.geometry.filter((_, place) => place % 9 === axis)));
    const towards = stored.eye.map((each, axis) => each - middle[axis]);
    const away = () => Float32Array.from({ length: number }, (_, each) => Math.hypot(...[0, 1, 2].map((axis) => model.geometry[9 * each + axis] - middle[axis])));
    const reach = stored.middle ? Math.hypot(...towards) * Math.sin(Math.atan(FIELD)) : quantile(away(), 0.98);
    model.middle = middle;
    model.frame = standing(stored.up, towards);
    model.radius = Math.max(reach, 1e-6);
    unpacked.set(key, model);
    return model;
  }

  const dot = (one, other) => one[0] * other[0] + one[1] * other[1] + one[2] * other[2];
  const cross = (one, other) => [one[1] * other[2] - one[2] * other[1], one[2] * other[0] - one[0] * other[2], one[0] * other[1] - one[1] * other[0]];
  const unit = (vector) => vector.map((each) => each / (Math.hypot(...vector) || 1));

  function standing(up, towards) { // axes of the turntable: towards the first eye, sideways and up; and how high that eye is
    const height = Math.asin(Math.min(1, Math.max(-1, dot(unit(towards), up))));
    const level = towards.map((each, axis) => each - dot(towards, up) * up[axis]);
    const forth = Math.hypot(...level) > 1e-6 ? unit(level) : unit(cross(up, Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]));
    return { forth, side: cross(up, forth), up, height };
  }

  const quantile = (values, share) => values.slice().sort()[Math.floor(share * (values.length - 1))];
  const median = (values) => quantile(values, 0.5);

  function program(gl, vertex, fragment) {
    const made = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
    return made;
  }

  function drawer(canvas) { // null where the browser cannot blend numbers finer than bytes
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false });
    if (!gl || !gl.getExtension("EXT_color_buffer_float") || !gl.getExtension("EXT_float_blend")) return null;
    const [blending, encoding] = [program(gl, VERTEX, FRAGMENT), program(gl, WHOLE, ENCODE)];
    const corners = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, corners);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1].map((each) => CORNER * each)), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    const instances = gl.createBuffer();
    const texture = gl.createTexture();
    const target = gl.createFramebuffer();
    let size = [0, 0];
    let sorted = new Float32Array(0);

    function resize() {
      const wanted = [canvas.clientWidth, canvas.clientHeight].map((each) => Math.max(1, Math.round(each * Math.min(devicePixelRatio, 2))));
      if (wanted.join() === size.join()) return;
      size = [canvas.width, canvas.height] = wanted;
      gl.bindTexture(gl.TEXTURE_2D, texture);
      for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, ...size, 0, gl.RGBA, gl.FLOAT, null);
      gl.bindFramebuffer(gl.FRAMEBUFFER, target);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    }

    function place(attribute, width, offset) {
      gl.enableVertexAttribArray(attribute);
      gl.vertexAttribPointer(attribute, width, gl.FLOAT, false, 4 * FLOATS, 4 * offset);
      gl.vertexAttribDivisor(attribute, 1);
    }

    return (model, shade, eye, matrix) => {
      resize();
      const order = farthestFirst(model, eye);
      if (sorted.length !== FLOATS * model.number) sorted = new Float32Array(FLOATS * model.number);
      for (let at = 0; at < model.number; at += 1) {
        const each = order[at];
        for (let part = 0; part < 9; part += 1) sorted[FLOATS * at + part] = model.geometry[9 * each + part];
        for (let part = 0; part < 4; part += 1) sorted[FLOATS * at + 9 + part] = shade[4 * each + part];
      }
      gl.bindFramebuffer(gl.FRAMEBUFFER, target);
      gl.viewport(0, 0, ...size);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT);
      gl.useProgram(blending);
      gl.uniformMatrix4fv(gl.getUniformLocation(blending, "projection"), false, matrix(size[0] / size[1]));
      gl.uniform3fv(gl.getUniformLocation(blending, "eye"), eye);
      gl.bindBuffer(gl.ARRAY_BUFFER, instances);
      gl.bufferData(gl.ARRAY_BUFFER, sorted, gl.DYNAMIC_DRAW);
      [[1, 3, 0], [2, 3, 3], [3, 3, 6], [4, 4, 9]].forEach((each) => place(...each));
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, model.number);
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      gl.disable(gl.BLEND);
      gl.useProgram(encoding);
      gl.uniform3fv(gl.getUniformLocation(encoding, "paper"), background());
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    };
  }

  function background() { // the page's own, in linear light
    const [, ...digits] = shared.colour("--raised").match(/^#(..)(..)(..)$/);
    return digits.map((each) => linear(parseInt(each, 16)));
  }

  function farthestFirst(model, eye) {
    const depth = new Float32Array(model.number);
    for (let each = 0; each < model.number; each += 1) {
      for (let axis = 0; axis < 3; axis += 1) depth[each] += (model.geometry[9 * each + axis] - eye[axis]) ** 2;
    }
    return Uint32Array.from(depth.keys()).sort((one, other) => depth[other] - depth[one]);
  }

  function seenFrom(model) { // eye, and the matrix from the world to the picture's clip space
    const { forth, side, up: upright, height } = model.frame;
    const tilt = Math.min(1.55, Math.max(-1.55, height + camera.tilt));
    const { turn, distance } = camera;
    const mixed = (one, other, third) => [0, 1, 2].map((axis) => one * forth[axis] + other * side[axis] + third * upright[axis]);
    const back = mixed(Math.cos(turn) * Math.cos(tilt), Math.sin(turn) * Math.cos(tilt), Math.sin(tilt));
    const away = (distance * model.radius) / Math.sin(Math.atan(FIELD));
    const eye = model.middle.map((each, axis) => each + away * back[axis]);
    const right = mixed(-Math.sin(turn), Math.cos(turn), 0);
    const up = cross(back, right);
    const along = (axis) => -dot(axis, eye);
    const near = 0.02 * model.radius;
    const far = away + 1e4 * model.radius;
    return [eye, (aspect) => {
      const [across, tall] = aspect > 1 ? [1 / (FIELD * aspect), 1 / FIELD] : [1 / FIELD, aspect / FIELD];
      const [depth, shift] = [(far + near) / (near - far), (2 * far * near) / (near - far)];
      const rows = [
        [...right.map((each) => across * each), across * along(right)],
        [...up.map((each) => tall * each), tall * along(up)],
        [...back.map((each) => depth * each), depth * along(back) + shift],
        [...back.map((each) => -each), -along(back)],
      ];
      return new Float32Array([0, 1, 2, 3].flatMap((column) => rows.map((row) => row[column])));
    }];
  }

  const drawers = [];

  function paint() {
    asked = false;
    [leftSelect, rightSelect].forEach((select, side) => {
      if (!select.value) return;
      drawers[side] ??= drawer(stages[side]);
      if (!drawers[side]) {
        said.textContent = "This browser has no WebGL 2 with floating-point colours: surfels cannot be shown.";
        return;
      }
      const model = unpack(select.value);
      drawers[side](model, model.shades[shownSelect.value], ...seenFrom(model));
    });
  }

  function repaint() {
    if (asked || !found("surfels-shown-here").open) return;
    asked = true;
    requestAnimationFrame(paint);
  }

  function tell() {
    [leftSelect, rightSelect].forEach((select, side) => {
      stages[side].closest("figure").hidden = !select.value;
    });
    const sizes = [leftSelect, rightSelect].filter((select) => select.value).map((select) => {
      const model = unpack(select.value);
      const text = model.number.toLocaleString("en");
      const count = model.number < model.count ? `the ${text} that cover most of ${model.count.toLocaleString("en")}` : text;
      return `${select.selectedOptions[0].textContent}: ${count} surfels`;
    });
    said.textContent = `${sizes.join("; ")}.`;
    repaint();
  }

  function turned(turn, tilt) {
    camera.turn -= turn;
    camera.tilt = Math.min(3.1, Math.max(-3.1, camera.tilt + tilt));
    repaint();
  }

  function nearer(factor) {
    camera.distance = Math.min(5, Math.max(0.05, camera.distance * factor));
    repaint();
  }

  const KEYS = {
    ArrowLeft: () => turned(-0.1, 0), ArrowRight: () => turned(0.1, 0), ArrowUp: () => turned(0, 0.1), ArrowDown: () => turned(0, -0.1),
    "+": () => nearer(1 / 1.2), "=": () => nearer(1 / 1.2), "-": () => nearer(1.2),
    0: () => { camera = { ...START }; repaint(); },
  };

  for (const stage of stages) {
    stage.addEventListener("pointerdown", (event) => stage.setPointerCapture(event.pointerId));
    stage.addEventListener("pointermove", (event) => {
      if (event.buttons & 1) turned((4 * event.movementX) / stage.clientWidth, (4 * event.movementY) / stage.clientHeight);
    });
    stage.addEventListener("wheel", (event) => {
      if (document.activeElement !== stage && !event.ctrlKey) return; // the page scrolls over pictures that were not clicked
      event.preventDefault();
      nearer(Math.exp(event.deltaY / 600));
    }, { passive: false });
    stage.addEventListener("keydown", (event) => {
      if (!(event.key in KEYS) || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      KEYS[event.key]();
    });
  }

  function follow() {
    const ticked = kept.filter((run) => shared.selection().holds(run));
    const offered = (ticked.length ? ticked : kept).map((run) => [run.key, nameOf(run)]);
    fill(leftSelect, offered);
    fill(rightSelect, [["", "nothing"], ...offered]);
    tell();
  }

  for (const select of [leftSelect, rightSelect, shownSelect]) select.addEventListener("change", tell);
  document.addEventListener("themechange", repaint);
  document.addEventListener("selection", follow);
  found("surfels-shown-here").addEventListener("toggle", tell);
  new ResizeObserver(repaint).observe(stages[0]);
  follow();
  const [first] = kept;
  const beside = kept.find((run) => run.scene === first.scene && run.seed === first.seed && run.row !== first.row);
  if (beside) {
    rightSelect.value = beside.key;
    tell();
  }
})();
