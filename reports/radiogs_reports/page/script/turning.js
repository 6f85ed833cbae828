// A camera that goes around a model, and whatever else dragging and arrow keys turn.
const turning = (() => {
  const FIELD = Math.tan((20 * Math.PI) / 180);
  const { dot, cross } = vectors;
  const within = (low, value, high) => Math.min(high, Math.max(low, value));

  function towards({ forth, side, up }, turn, height) { // a direction by its angles in a turntable's axes
    return forth.map((each, axis) => Math.cos(height) * (Math.cos(turn) * each + Math.sin(turn) * side[axis]) + Math.sin(height) * up[axis]);
  }

  function seenFrom(model, { turn, tilt, distance }) { // eye, unit vector towards it, and by aspect the matrix to clip space
    const back = towards(model.frame, turn, within(-1.55, model.frame.height + tilt, 1.55));
    const away = (distance * model.radius) / Math.sin(Math.atan(FIELD));
    const eye = model.middle.map((each, axis) => each + away * back[axis]);
    const right = towards(model.frame, turn + Math.PI / 2, 0);
    const up = cross(back, right);
    const along = (axis) => -dot(axis, eye);
    const near = 0.02 * model.radius;
    const far = away + 1e4 * model.radius;
    return { eye, back, matrix(aspect) {
      const [across, tall] = aspect > 1 ? [1 / (FIELD * aspect), 1 / FIELD] : [1 / FIELD, aspect / FIELD];
      const [depth, shift] = [(far + near) / (near - far), (2 * far * near) / (near - far)];
      const rows = [
        [...right.map((each) => across * each), across * along(right)],
        [...up.map((each) => tall * each), tall * along(up)],
        [...back.map((each) => depth * each), depth * along(back) + shift],
        [...back.map((each) => -each), -along(back)],
      ];
      return new Float32Array([0, 1, 2, 3].flatMap((column) => rows.map((row) => row[column])));
    } };
  }

  function follow(stage, { turned, nearer, anew }) { // by pointer, wheel and keys
    const KEYS = {
      ArrowLeft: () => turned(-0.1, 0), ArrowRight: () => turned(0.1, 0), ArrowUp: () => turned(0, 0.1), ArrowDown: () => turned(0, -0.1),
      "+": () => nearer(1 / 1.2), "=": () => nearer(1 / 1.2), "-": () => nearer(1.2), 0: anew,
    };
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

  return { FIELD, within, towards, seenFrom, follow };
})();
