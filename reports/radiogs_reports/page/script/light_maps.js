// Distant light: files read and reduced to 32 rows, stood in the world, and gathered into the directions of the bits.
const lightMaps = (() => {
  const HEIGHT = 32;
  const CELLS = 512; // directions along which it is kept whether surfels see the light, see light_paths in Python
  const ENTRIES = CELLS + 16; // further ones are the sun's
  const REACH = (10 * Math.PI) / 180; // light is shared among the directions within this angle
  const SPREAD = { cell: 2e-3, sun: 4e-5 }; // added to the lobe's alpha^2: how far half-vectors to their light spread
  const MOST = { bytes: 2 ** 27, hdr: 2 ** 25, png: 2 ** 23 }; // of a file; texels of one
  const GOLDEN = Math.PI * (3 - Math.sqrt(5));
  const { dot, cross, unit } = vectors;

  const directions = Array.from({ length: CELLS }, (_, each) => {
    const height = 1 - (2 * each + 1) / CELLS;
    const level = Math.sqrt(1 - height ** 2);
    return [level * Math.cos(each * GOLDEN), level * Math.sin(each * GOLDEN), height];
  });
  const texels = Array.from({ length: 2 * HEIGHT ** 2 }, (_, each) => { // towards it, and its solid angle
    const [row, column] = [Math.floor(each / (2 * HEIGHT)), each % (2 * HEIGHT)];
    const [polar, azimuth] = [((row + 0.5) * Math.PI) / HEIGHT, Math.PI - ((column + 0.5) * Math.PI) / HEIGHT];
    const size = (Math.cos((row * Math.PI) / HEIGHT) - Math.cos(((row + 1) * Math.PI) / HEIGHT)) * (Math.PI / HEIGHT);
    return { towards: [Math.sin(polar) * Math.cos(azimuth), Math.sin(polar) * Math.sin(azimuth), Math.cos(polar)], size };
  });

  function averaged(width, height, most) { // collects rows of linear radiance, three numbers a texel
    if (width !== 2 * height) throw new Error(`is ${width} x ${height}: a map of the whole sphere is twice as wide as high.`);
    if (height < HEIGHT) throw new Error(`has ${height} rows, ${HEIGHT} are needed.`);
    if (width * height > most) throw new Error(`is ${width} x ${height}: at most ${most.toLocaleString("en")} texels are read.`);
    const [sums, counts] = [new Float32Array(6 * HEIGHT ** 2), new Uint32Array(2 * HEIGHT ** 2)];
    return {
      add(row, values) {
        for (let column = 0; column < width; column += 1) {
          const texel = 2 * HEIGHT * Math.floor((row * HEIGHT) / height) + Math.floor((2 * HEIGHT * column) / width);
          counts[texel] += 1;
          for (let channel = 0; channel < 3; channel += 1) sums[3 * texel + channel] += values(column, channel);
        }
      },
      mean: () => sums.map((sum, place) => sum / counts[Math.floor(place / 3)]),
    };
  }

  function fromHdr(bytes) {
    let at = 0;
    const line = () => {
      const end = bytes.indexOf(10, at);
      if (end < 0 || end - at > 200) throw new Error("has no header of a Radiance file.");
      const text = String.fromCharCode(...bytes.subarray(at, end));
      at = end + 1;
      return text;
    };
    if (!line().startsWith("#?")) throw new Error("is no Radiance file.");
    for (let text = line(); text; text = line()) if (text.includes("xyze")) throw new Error("holds XYZ, RGB is needed.");
    const [, height, width] = (line().match(/^-Y (\d+) \+X (\d+)$/) ?? []).map(Number);
    if (!height) throw new Error("has rows in another order than from top to bottom.");
    const made = averaged(width, height, MOST.hdr);
    const row = new Uint8Array(4 * width); // the mantissas of red, green and blue, and the exponents
    for (let each = 0; each < height; each += 1) {
      at = scanline(bytes, at, row, width);
      made.add(each, (column, channel) => row[channel * width + column] * 2 ** (row[3 * width + column] - 136));
    }
    return made.mean();
  }

  function scanline(bytes, start, row, width) { // returns where the next one begins
    const packed = bytes[start] === 2 && bytes[start + 1] === 2 && bytes[start + 2] * 256 + bytes[start + 3] === width;
    if (!packed) {
      for (let place = 0; place < 4 * width; place += 1) row[(place % 4) * width + Math.floor(place / 4)] = bytes[start + place];
    }
    let at = start + 4 * (packed ? 1 : width);
    for (let place = 0; packed && place < 4 * width && at < bytes.length;) {
      const length = bytes[at] > 128 ? bytes[at] - 128 : bytes[at];
      if (bytes[at] > 128) row.fill(bytes[at + 1], place, place + length);
      else row.set(bytes.subarray(at + 1, at + 1 + Math.min(length, row.length - place)), place);
      at += bytes[at] > 128 ? 2 : 1 + length;
      place += Math.max(1, length);
    }
    if (at > bytes.length) throw new Error("ends before its last row.");
    return at;
  }

  async function fromPng(file, bytes) { // display colours become linear radiance of at most 1
    const header = new DataView(bytes.buffer);
    if (header.getUint32(0) !== 0x89504e47) throw new Error("is no PNG.");
    const [width, height] = [header.getUint32(16), header.getUint32(20)];
    const made = averaged(width, height, MOST.png); // before it is decoded
    const canvas = Object.assign(document.createElement("canvas"), { width, height });
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(await createImageBitmap(file), 0, 0);
    for (let row = 0; row < height; row += 1) {
      const levels = context.getImageData(0, row, width, 1).data;
      made.add(row, (column, channel) => vectors.linear(levels[4 * column + channel]));
    }
    return made.mean();
  }

  async function fromFile(file) { // linear radiance of 32 x 64 texels; an Error says what the file is instead
    if (file.size > MOST.bytes) throw new Error(`has ${file.size.toLocaleString("en")} bytes: at most ${MOST.bytes.toLocaleString("en")} are read.`);
    const bytes = new Uint8Array(await file.arrayBuffer());
    if (bytes.length < 24) throw new Error("is too short for a map of light.");
    return bytes[0] === 0x89 ? fromPng(file, bytes) : fromHdr(bytes);
  }

  function placing(up, turn, upright) { // from a map to the world: its top is up if it is to stand upright, then turned about up
    const lean = [-up[1], up[0], 0];
    const stood = (towards) => {
      if (!upright) return towards;
      if (up[2] < -1 + 1e-9) return [towards[0], -towards[1], -towards[2]];
      const once = cross(lean, towards);
      const twice = cross(lean, once);
      return towards.map((each, axis) => each + once[axis] + twice[axis] / (1 + up[2]));
    };
    const [cosine, sine] = [Math.cos(turn), Math.sin(turn)];
    return (towards) => {
      const before = stood(towards);
      const [sideways, along] = [cross(up, before), dot(up, before)];
      return before.map((each, axis) => cosine * each + sine * sideways[axis] + (1 - cosine) * along * up[axis]);
    };
  }

  function shares(towards) { // of the directions near to one, as [direction, share]
    const near = [];
    let whole = 0;
    for (let each = 0; each < CELLS; each += 1) {
      const share = 1 - (2 * (1 - dot(directions[each], towards))) / REACH ** 2;
      if (share > 0) near.push([each, share]);
      whole += Math.max(0, share);
    }
    return near.map(([each, share]) => [each, share / whole]);
  }

  // What shaders read: a row of irradiances with spreads, a row of mean directions with the numbers of bits.
  function entries(radiance, { up, turn, upright, strength, sun }) {
    const made = new Float32Array(8 * ENTRIES);
    const place = placing(up, turn, upright);
    const means = directions.map((towards) => towards.map((each) => 1e-9 * each));
    texels.forEach(({ towards, size }, texel) => {
      const light = [0, 1, 2].map((channel) => strength * size * radiance[3 * texel + channel]);
      if (!(light[0] + light[1] + light[2] > 0)) return;
      const there = place(towards);
      for (const [each, share] of shares(there)) {
        for (let channel = 0; channel < 3; channel += 1) {
          made[4 * each + channel] += share * light[channel];
          means[each][channel] += share * (light[0] + light[1] + light[2]) * there[channel];
        }
      }
    });
    means.forEach((mean, each) => {
      made[4 * each + 3] = SPREAD.cell;
      made.set([...unit(mean), each], 4 * (ENTRIES + each));
    });
    const further = sun.strength > 0 ? shares(sun.towards) : [];
    further.forEach(([bit, share], each) => {
      made.set([share, share, share].map((part) => part * sun.strength).concat(SPREAD.sun), 4 * (CELLS + each));
      made.set([...sun.towards, bit], 4 * (ENTRIES + CELLS + each));
    });
    return { values: made, width: ENTRIES, count: CELLS + further.length };
  }

  return { fromFile, fromHdr, entries };
})();
