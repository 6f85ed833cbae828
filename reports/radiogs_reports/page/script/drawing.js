// Surfels as Gaussians on their own planes, widened by the footprint of a pixel, blended from back to front.
const drawing = (() => {
  const VERTEX = `
    uniform sampler2D centre, first, second, colour;
    uniform mat4 projection;
    uniform vec3 eye, back;
    uniform float pixel; // side of one at depth 1
    uniform usampler2D order; // farthest first
    out vec2 place;
    flat out vec4 shade;
    const vec4 NOWHERE = vec4(2.0, 2.0, 2.0, 1.0);
    const vec2 CORNERS[6] = vec2[6](vec2(-1, -1), vec2(1, -1), vec2(-1, 1), vec2(-1, 1), vec2(1, -1), vec2(1, 1));
    void main() { // see kernels/surfel/footprint.inl
      int across = textureSize(centre, 0).x; // six vertices a surfel: software renderers are slow at instances
      int surfel = int(texelFetch(order, ivec2(gl_VertexID / 6 % across, gl_VertexID / 6 / across), 0).r);
      ivec2 at = ivec2(surfel % across, surfel / across);
      vec4 middle = texelFetch(centre, at, 0);
      vec3 u = texelFetch(first, at, 0).xyz;
      vec3 v = texelFetch(second, at, 0).xyz;
      vec2 size = vec2(length(u), length(v));
      gl_Position = NOWHERE;
      place = vec2(0.0);
      shade = vec4(0.0);
      if (min(size.x, size.y) <= 0.0) return;
      u /= size.x;
      v /= size.y;
      vec3 away = eye - middle.xyz;
      vec3 along = vec3(dot(u, away), dot(v, away), dot(cross(u, v), away)) / length(away);
      if (along.z <= 0.0) return; // seen from behind
      float side = pixel * abs(dot(away, back));
      float variance = side * side / 12.0;
      float stretch = variance / max(along.z * along.z, 0.0025);
      float wide = sqrt(size.x * size.x + variance + stretch * along.x * along.x);
      float mixed = stretch * along.x * along.y / wide;
      float high = sqrt(size.y * size.y + variance + stretch * along.y * along.y - mixed * mixed);
      float opacity = middle.a * size.x * size.y / (wide * high);
      if (255.0 * opacity <= 1.0) return;
      place = sqrt(2.0 * log(255.0 * opacity)) * CORNERS[gl_VertexID % 6]; // where it is fainter than a level it is not drawn
      shade = vec4(min(texelFetch(colour, at, 0).rgb, vec3(6e4)), opacity);
      gl_Position = projection * vec4(middle.xyz + place.x * (wide * u + mixed * v) + place.y * high * v, 1.0);
    }`;
  const FRAGMENT = `
    in vec2 place; // on the surfel's plane, where the pixel's ray meets it
    flat in vec4 shade;
    out vec4 seen;
    void main() {
      float alpha = min(shade.a * exp(-0.5 * dot(place, place)), 0.99);
      if (255.0 * alpha < 1.0) discard;
      seen = vec4(shade.rgb * alpha, alpha);
    }`;
  const ENCODE = ` // as an image with coverage, before the page
    uniform sampler2D blended;
    uniform vec3 paper;
    out vec4 seen;
    void main() {
      vec4 light = texelFetch(blended, ivec2(gl_FragCoord.xy), 0);
      vec3 level = light.a > 0.0 ? encoded(light.rgb / light.a) : vec3(0.0);
      seen = vec4(mix(paper, min(level, vec3(1.0)), light.a), 1.0);
    }`;

  function farthestFirst({ number, rows, across, centre }, back) { // by the depth of their middles, as the renderer
    const depth = Float32Array.from({ length: number }, (_, each) => centre[4 * each] * back[0] + centre[4 * each + 1] * back[1] + centre[4 * each + 2] * back[2]);
    const order = new Uint32Array(rows * across);
    order.set(Uint32Array.from(depth.keys()).sort((one, other) => depth[one] - depth[other]));
    return order;
  }

  function drawer(canvas) { // null where the browser cannot draw into numbers finer than bytes
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false });
    const whole = gl?.getExtension("EXT_color_buffer_float");
    if (!gl || !(whole || gl.getExtension("EXT_color_buffer_half_float"))) return null;
    const shade = shading.shader(gl, whole ? gl.RGBA32F : gl.RGBA16F);
    const [blending, encoding] = [gpu.program(gl, FRAGMENT, VERTEX), gpu.program(gl, ENCODE)];
    let [size, texture, target] = [[0, 0], null, null];
    let [order, drawn, sorted] = [null, null, ""];

    function resize() {
      const wanted = [canvas.clientWidth, canvas.clientHeight].map((each) => Math.max(1, Math.round(each * Math.min(devicePixelRatio, 2))));
      if (wanted.join() === size.join()) return;
      size = [canvas.width, canvas.height] = wanted;
      gl.deleteTexture(texture);
      gl.deleteFramebuffer(target);
      texture = gpu.texture(gl, gl.RGBA16F, ...size);
      target = gpu.into(gl, [texture]);
    }

    function sort(model, back) {
      if (drawn === model && sorted === back.join()) return;
      [drawn, sorted] = [model, back.join()];
      gl.deleteTexture(order);
      order = gpu.texture(gl, gl.R32UI, model.across, model.rows, farthestFirst(model, back));
    }

    return (model, light, { eye, back, matrix }, seen, paper) => {
      resize();
      const { centre, first, second, colour } = shade(model, light, eye, seen);
      sort(model, back);
      gl.bindFramebuffer(gl.FRAMEBUFFER, target);
      gl.viewport(0, 0, ...size);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      const pixel = [(2 * turning.FIELD) / Math.min(...size)];
      gpu.use(gl, blending, { centre, first, second, colour, order }, { projection: matrix(size[0] / size[1]), eye, back, pixel });
      gl.drawArrays(gl.TRIANGLES, 0, 6 * model.number);
      gpu.pass(gl, null, size, encoding, { blended: texture }, { paper });
    };
  }

  return { drawer };
})();
