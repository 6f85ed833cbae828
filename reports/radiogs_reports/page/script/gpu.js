// WebGL 2 in small: programs, textures, and targets of passes.
const gpu = (() => {
  const HEAD = `#version 300 es
    precision highp float;
    precision highp int;
    precision highp sampler2D;
    precision highp usampler2D;
    vec3 encoded(vec3 light) { return mix(12.92 * light, 1.055 * pow(max(light, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, light)); }
    vec3 decoded(vec3 level) { return mix(level / 12.92, pow((max(level, vec3(0.04045)) + 0.055) / 1.055, vec3(2.4)), step(0.04045, level)); }
    `;
  const WHOLE = "void main() { gl_Position = vec4(2.0 * vec2((gl_VertexID << 1) & 2, gl_VertexID & 2) - 1.0, 0.0, 1.0); }";

  function program(gl, fragment, vertex = WHOLE) {
    const made = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, HEAD + source);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error([...gl.getAttachedShaders(made).map((each) => gl.getShaderInfoLog(each)), gl.getProgramInfoLog(made)].join("\n"));
    return made;
  }

  function texture(gl, format, width, height, values = null) { // format: RGBA32F, RGBA16F, RGBA32UI or R32UI
    const made = gl.createTexture();
    const { RGBA, RED_INTEGER, RGBA_INTEGER, UNSIGNED_INT, HALF_FLOAT, FLOAT } = gl;
    const [order, type] = { [gl.R32UI]: [RED_INTEGER, UNSIGNED_INT], [gl.RGBA32UI]: [RGBA_INTEGER, UNSIGNED_INT], [gl.RGBA16F]: [RGBA, HALF_FLOAT], [gl.RGBA32F]: [RGBA, FLOAT] }[format];
    gl.bindTexture(gl.TEXTURE_2D, made);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
    gl.texImage2D(gl.TEXTURE_2D, 0, format, width, height, 0, order, type, values);
    return made;
  }

  function into(gl, textures) { // a target of passes
    const made = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, made);
    const places = textures.map((each, place) => {
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + place, gl.TEXTURE_2D, each, 0);
      return gl.COLOR_ATTACHMENT0 + place;
    });
    gl.drawBuffers(places);
    return made;
  }

  function use(gl, made, textures, numbers) { // numbers: lists of one to four, or sixteen for a matrix
    gl.useProgram(made);
    Object.entries(textures).forEach(([name, each], unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, each);
      gl.uniform1i(gl.getUniformLocation(made, name), unit);
    });
    for (const [name, value] of Object.entries(numbers)) {
      const place = gl.getUniformLocation(made, name);
      if (value.length === 16) gl.uniformMatrix4fv(place, false, value);
      else gl[`uniform${value.length}fv`](place, value);
    }
  }

  function pass(gl, target, [width, height], made, textures, numbers = {}) { // over the whole target
    gl.bindFramebuffer(gl.FRAMEBUFFER, target);
    gl.viewport(0, 0, width, height);
    gl.disable(gl.BLEND);
    use(gl, made, textures, numbers);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  return { program, texture, into, use, pass };
})();
