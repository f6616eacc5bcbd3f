// The slider through the drive, and the button that plays it.
const SECONDS = 40; // a drive plays in about so long

function makeTime(run, slider, output, button, show) {
  const last = run.rows.length - 1;
  let playing = null;
  slider.max = last;
  const set = (k) => {
    slider.value = k;
    const text = `scan ${run.rows[k]} of ${run.scans - 1}, ${run.time[k].toFixed(1)} s`;
    output.textContent = text;
    slider.setAttribute("aria-valuetext", text);
    show(k);
  };
  const stop = () => {
    cancelAnimationFrame(playing);
    playing = null;
    button.textContent = "Play";
    button.setAttribute("aria-pressed", "false");
  };
  const play = () => {
    const from = Number(slider.value) >= last ? 0 : Number(slider.value), began = performance.now();
    button.textContent = "Pause";
    button.setAttribute("aria-pressed", "true");
    const step = (now) => {
      const k = Math.min(last, Math.round(from + (now - began) / 1000 * (last + 1) / SECONDS));
      if (k !== Number(slider.value)) set(k);
      if (k >= last) stop(); else playing = requestAnimationFrame(step);
    };
    playing = requestAnimationFrame(step);
  };
  slider.addEventListener("input", () => { if (playing) stop(); set(Number(slider.value)); });
  button.addEventListener("click", () => (playing ? stop() : play()));
  return set;
}
