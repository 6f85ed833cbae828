// Vectors, and a model's packed surfels as arrays for textures: 256 surfels a row, so many texels of four numbers each.
const vectors = (() => {
  const dot = (one, other) => one[0] * other[0] + one[1] * other[1] + one[2] * other[2];
  const cross = (one, other) => [one[1] * other[2] - one[2] * other[1], one[2] * other[0] - one[0] * other[2], one[0] * other[1] - one[1] * other[0]];
  const unit = (vector) => vector.map((each) => each / (Math.hypot(...vector) || 1));
  const linear = (byte) => (byte / 255 <= 0.04045 ? byte / 255 / 12.92 : ((byte / 255 + 0.055) / 1.055) ** 2.4);
  return { dot, cross, unit, linear };
})();

const surfelData = (() => {
  const ACROSS = 256;
  const BYTES = 26; // a surfel's, see page/surfels.py
  const WORDS = 16; // of 512 bits, and of 32 surfels that are met
  const { dot, cross, unit, linear } = vectors;
  const bytesOf = (text) => Uint8Array.from(atob(text), (each) => each.charCodeAt(0));

  function unpacked(stored) {
    const view = new DataView(bytesOf(stored.surfels).buffer);
    const number = view.byteLength / BYTES;
    const rows = Math.max(1, Math.ceil(number / ACROSS));
    const made = { number, rows, across: ACROSS, count: stored.count, up: stored.up };
    for (const name of ["centre", "first", "second", "material", "radiance"]) made[name] = new Float32Array(4 * ACROSS * rows);
    for (let each = 0; each < number; each += 1) {
      const at = each * BYTES;
      for (let axis = 0; axis < 3; axis += 1) {
        made.centre[4 * each + axis] = stored.low[axis] + stored.step[axis] * view.getUint16(at + 2 * axis, true);
        made.first[4 * each + axis] = (stored.reach * view.getInt16(at + 6 + 2 * axis, true)) / 32767;
        made.second[4 * each + axis] = (stored.reach * view.getInt16(at + 12 + 2 * axis, true)) / 32767;
        made.radiance[4 * each + axis] = linear(view.getUint8(at + 19 + axis));
        made.material[4 * each + axis] = linear(view.getUint8(at + 22 + axis));
      }
      made.centre[4 * each + 3] = view.getUint8(at + 18) / 255;
      made.material[4 * each + 3] = view.getUint8(at + 25) / 255;
    }
    return { ...made, ...lightPaths(stored, rows), ...surroundings(stored, made) };
  }

  function lightPaths(stored, rows) { // nothing where a result keeps none
    const { seen, met, ...lit } = stored.relit;
    if (!seen) return { relightable: false, lights: {} };
    const words = (text) => {
      const made = new Uint32Array(WORDS * ACROSS * rows);
      new Uint8Array(made.buffer).set(bytesOf(text));
      return made;
    };
    const lights = Object.fromEntries(Object.entries(lit).map(([name, text]) => [name.replace("light/", ""), new Float32Array(bytesOf(text).buffer)]));
    return { relightable: true, bits: words(seen), met: words(met), lights };
  }

  function surroundings(stored, { number, centre }) { // what is looked at, the turntable's axes, and how far the eye is
    const coordinates = (axis) => Float32Array.from({ length: number }, (_, each) => centre[4 * each + axis]);
    const middle = stored.middle ?? [0, 1, 2].map((axis) => quantile(coordinates(axis), 0.5));
    const towards = stored.eye.map((each, axis) => each - middle[axis]);
    const away = () => Float32Array.from({ length: number }, (_, each) => Math.hypot(...middle.map((place, axis) => centre[4 * each + axis] - place)));
    const reach = stored.middle ? Math.hypot(...towards) * Math.sin(Math.atan(turning.FIELD)) : quantile(away(), 0.98);
    return { middle, frame: standing(stored.up, towards), radius: Math.max(reach, 1e-6) };
  }

  function standing(up, towards) { // axes of the turntable: towards the first eye, sideways and up; and how high that eye is
    const height = Math.asin(Math.min(1, Math.max(-1, dot(unit(towards), up))));
    const level = towards.map((each, axis) => each - dot(towards, up) * up[axis]);
    const forth = Math.hypot(...level) > 1e-6 ? unit(level) : unit(cross(up, Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]));
    return { forth, side: cross(up, forth), up, height };
  }

  const quantile = (values, share) => values.slice().sort()[Math.floor(share * (values.length - 1))];
  return { bytesOf, unpacked };
})();
