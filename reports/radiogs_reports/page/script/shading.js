// Surfels under a light, in passes over textures of surfels: direct light by the bits, bounces by the surfels that are met.
const shading = (() => {
  const BOUNCES = 6; // surfaces that light meets at most before it arrives
  const SEEN = ["relit", "direct", "indirect", "albedo", "normal", "roughness", "radiance"];
  const LIT = 3; // so many of them depend on the light

  const BRDF = ` // see kernels/shade/brdf.py
    vec3 normalOf(sampler2D first, sampler2D second, ivec2 at) {
      vec3 normal = cross(texelFetch(first, at, 0).xyz, texelFetch(second, at, 0).xyz);
      return normal / max(length(normal), 1e-30);
    }
    float lobeAlbedo(float r) { return 0.0585 + r * (0.0039 * r - 0.0456); } // of transport/shading.py, to 0.001
    float lobe(vec3 n, vec3 wo, vec3 wi, float r, float spread) {
      vec3 halfway = normalize(wo + wi);
      float alpha2 = r * r * r * r + spread;
      float c = dot(n, halfway);
      vec3 s = cross(n, halfway - n);
      float denominator = alpha2 * c * c + dot(s, s);
      float h = dot(halfway, wo);
      float fresnel = 0.04 + 0.96 * exp2((-5.55473 * h - 6.98316) * h);
      float k = (r + 1.0) * (r + 1.0) / 8.0;
      float masking = 0.25 / ((dot(n, wo) * (1.0 - k) + k) * (dot(n, wi) * (1.0 - k) + k));
      return alpha2 / (3.14159265 * denominator * denominator) * fresnel * masking;
    }
    float lobeTowards(float r, float cosine) { // the share of light from everywhere that the lobe sends to a view (Karis 2014)
      vec4 fit = r * vec4(-1.0, -0.0275, -0.572, 0.022) + vec4(1.0, 0.0425, 1.04, -0.04);
      float a = min(fit.x * fit.x, exp2(-9.28 * cosine)) * fit.x + fit.y;
      return 0.04 * (fit.z - 1.04 * a) + 1.04 * a + fit.w;
    }`;
  const DIRECT = `${BRDF}
    uniform sampler2D centre, first, second, material, light;
    uniform usampler2D bits;
    uniform vec3 eye;
    uniform float count;
    layout(location = 0) out vec4 diffuse; // arriving radiance, mean by the cosine
    layout(location = 1) out vec4 specular;
    void main() {
      ivec2 at = ivec2(gl_FragCoord.xy);
      vec3 n = normalOf(first, second, at);
      vec3 wo = normalize(eye - texelFetch(centre, at, 0).xyz);
      float roughness = texelFetch(material, at, 0).a;
      bool faces = dot(n, wo) > 0.0;
      diffuse = specular = vec4(0.0);
      for (int each = 0; each < int(count); ++each) {
        vec4 where = texelFetch(light, ivec2(each, 1), 0);
        float cosine = dot(n, where.xyz);
        if (cosine <= 0.0) continue;
        int bit = int(where.w);
        uint word = texelFetch(bits, ivec2(4 * at.x + (bit >> 7), at.y), 0)[(bit >> 5) & 3];
        if (((word >> uint(bit & 31)) & 1u) == 0u) continue;
        vec4 energy = texelFetch(light, ivec2(each, 0), 0);
        diffuse.rgb += cosine * energy.rgb / 3.14159265;
        if (faces) specular.rgb += cosine * lobe(n, wo, where.xyz, roughness, energy.a) * energy.rgb;
      }
    }`;
  const GATHER = `${BRDF}
    uniform sampler2D diffuse, sent, material;
    uniform usampler2D met;
    uniform float first; // whether only direct light is sent
    layout(location = 0) out vec4 sends;
    layout(location = 1) out vec4 arriving; // mean by the cosine of what the surfels that are met send
    vec3 from(uint place, int across) {
      return place == 65535u ? vec3(0.0) : texelFetch(sent, ivec2(int(place) % across, int(place) / across), 0).rgb;
    }
    void main() {
      ivec2 at = ivec2(gl_FragCoord.xy);
      int across = textureSize(sent, 0).x;
      vec4 surface = texelFetch(material, at, 0);
      float lobe = lobeAlbedo(surface.a);
      vec3 total = vec3(0.0);
      for (int four = 0; four < 4 && first == 0.0; ++four) {
        uvec4 words = texelFetch(met, ivec2(4 * at.x + four, at.y), 0);
        for (int k = 0; k < 4; ++k) total += from(words[k] & 65535u, across) + from(words[k] >> 16, across);
      }
      arriving = vec4(total / 32.0, 1.0);
      sends = vec4((min(surface.rgb, vec3(1.0 - lobe)) + lobe) * (texelFetch(diffuse, at, 0).rgb + arriving.rgb), 1.0);
    }`;
  const SHOWN = `${BRDF}
    uniform sampler2D centre, first, second, material, radiance, diffuse, specular, arriving;
    uniform vec3 eye;
    uniform float seen;
    out vec4 colour;
    void main() {
      ivec2 at = ivec2(gl_FragCoord.xy);
      vec4 surface = texelFetch(material, at, 0);
      vec3 n = normalOf(first, second, at);
      float cosine = max(dot(n, normalize(eye - texelFetch(centre, at, 0).xyz)), 0.0);
      vec3 mean = texelFetch(arriving, at, 0).rgb;
      vec3 direct = surface.rgb * texelFetch(diffuse, at, 0).rgb + texelFetch(specular, at, 0).rgb;
      vec3 indirect = mean * (surface.rgb + lobeTowards(surface.a, cosine));
      vec3 other[4] = vec3[4](surface.rgb, decoded(0.5 + 0.5 * n), decoded(surface.aaa), texelFetch(radiance, at, 0).rgb);
      colour = vec4(seen == 0.0 ? direct + indirect : seen == 1.0 ? direct : seen == 2.0 ? indirect : other[int(seen) - ${LIT}], 1.0);
    }`;

  function shader(gl, format) { // of one canvas; format: of what passes write
    const [direct, gather, shown] = [DIRECT, GATHER, SHOWN].map((source) => gpu.program(gl, source));
    const held = new Map();
    let [light, lightTexture] = [null, null];

    function hold(model) { // the textures of a model; those of its light are written by passes
      if (held.has(model)) return held.get(model);
      const size = [model.across, model.rows];
      const made = { size, lit: null, eye: "" };
      for (const name of ["centre", "first", "second", "material", "radiance"]) made[name] = gpu.texture(gl, gl.RGBA32F, ...size, model[name]);
      for (const name of ["bits", "met"]) made[name] = model.relightable ? gpu.texture(gl, gl.RGBA32UI, 4 * size[0], size[1], model[name]) : null;
      for (const name of ["diffuse", "specular", "sent", "sends", "arriving", "colour"]) made[name] = gpu.texture(gl, format, ...size);
      made.toDirect = gpu.into(gl, [made.diffuse, made.specular]);
      made.toSends = [made.sent, made.sends].map((each) => gpu.into(gl, [each, made.arriving]));
      made.toColour = gpu.into(gl, [made.colour]);
      held.set(model, made);
      return made;
    }

    function bounce(surfels) { // both textures of what is sent are read and written in turn
      const turns = [surfels.sent, surfels.sends];
      for (let each = 0; each <= BOUNCES; each += 1) {
        const { size, diffuse, material, met } = surfels;
        gpu.pass(gl, surfels.toSends[each % 2], size, gather, { diffuse, sent: turns[1 - (each % 2)], material, met }, { first: [each ? 0 : 1] });
      }
    }

    function relight(surfels, lit, eye) {
      if (surfels.lit === lit && surfels.eye === eye.join()) return;
      if (light !== lit) {
        gl.deleteTexture(lightTexture);
        [light, lightTexture] = [lit, gpu.texture(gl, gl.RGBA32F, lit.width, 2, lit.values)];
      }
      const { centre, first, second, material, bits, size } = surfels;
      gpu.pass(gl, surfels.toDirect, size, direct, { centre, first, second, material, light: lightTexture, bits }, { eye, count: [lit.count] });
      if (surfels.lit !== lit) bounce(surfels);
      [surfels.lit, surfels.eye] = [lit, eye.join()];
    }

    return (model, lit, eye, seen) => { // textures of the model, with ``colour`` as it is to be seen
      const surfels = hold(model);
      if (SEEN.indexOf(seen) < LIT) relight(surfels, lit, eye);
      const { centre, first, second, material, radiance, diffuse, specular, arriving } = surfels;
      gpu.pass(gl, surfels.toColour, surfels.size, shown, { centre, first, second, material, radiance, diffuse, specular, arriving }, { eye, seen: [SEEN.indexOf(seen)] });
      return surfels;
    };
  }

  return { shader, isLit: (seen) => SEEN.indexOf(seen) < LIT };
})();
