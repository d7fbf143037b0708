"use strict";
// Moves the picture of the machine: real places are drawn away from the believed ones by a factor.
(() => {
  const data = JSON.parse(document.querySelector("script.motion").textContent);
  const form = document.querySelector("form.controls");
  const svg = form.closest("figure").querySelector("svg");
  const part = name => svg.querySelector(`[data-part="${name}"]`);
  const set = (name, values) => {
    for (const key of Object.keys(values)) part(name).setAttribute(key, values[key].toFixed(2));
  };

  // Turns about the z axis, then looks along the space diagonal.
  const onPaper = ([x, y, z], turn) => {
    const [c, s] = [Math.cos(turn), Math.sin(turn)];
    const turned = [c * x - s * y, s * x + c * y, z];
    return [0, 1].map(k => data.centre[k]
      + turned.reduce((sum, value, axis) => sum + value * data.axes[axis][k], 0));
  };
  const between = (from, to) => ({ x1: from[0], y1: from[1], x2: to[0], y2: to[1] });

  const draw = () => {
    const value = name => Number(form.elements[name].value);
    const when = form.elements.when.value, turn = value("turn") * Math.PI / 180;
    const frame = data.frames[value("posture")], factor = data.enlarged[value("enlarged")];
    const place = point => onPaper(point, turn);
    const believed = frame.nominal.map(place);
    const real = frame.nominal.map((point, k) =>
      place(point.map((at, axis) => at + factor * (frame[when][k][axis] - at))));
    data.names.forEach((name, leg) => {
      const [low, high, label] = data.rails[leg].map(place);
      set(`rail-${name}`, between(low, high));
      set(`name-${name}`, { x: label[0], y: label[1] + 4 });
      set(`ghost-${name}`, between(believed[leg], believed[3]));
      set(`leg-${name}`, between(real[leg], real[3]));
      set(`carriage-${name}`, { x: real[leg][0] - 7, y: real[leg][1] - 7 });
    });
    set("ghost-tool", { cx: believed[3][0], cy: believed[3][1] });
    set("tool", { cx: real[3][0], cy: real[3][1] });
    const off = frame[when][3].map((at, axis) => at - frame.nominal[3][axis]);
    // A no-break space: an axis stays beside its value.
    const signed = off.map((mm, axis) =>
      `${data.names[axis]}\u00a0${mm < 0 ? "" : "+"}${mm.toFixed(3)}`);
    form.querySelector("output").textContent = `${frame.posture}, ${when}: tool off by`
      + ` ${Math.hypot(...off).toFixed(3)} mm (${signed.join(", ")}), drawn × ${factor}.`;
  };

  form.elements.posture.value = data.start.posture;
  form.elements.enlarged.value = data.start.enlarged;
  form.elements.turn.value = 0;
  form.elements.when.value = data.when[0];
  form.addEventListener("input", draw);
  form.addEventListener("submit", event => event.preventDefault());
  form.hidden = false;
  draw();
})();
