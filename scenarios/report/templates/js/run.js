// The run: the content of the page, its arrays decoded when first asked for.
function once(make) {
  let made, done = false;
  return () => { if (!done) { made = make(); done = true; } return made; };
}

function readRun() {
  const content = JSON.parse(document.getElementById("run-data").textContent);
  const drive = content.drive;
  const truth = numbers(drive.truth);
  return {
    best: content.best, world: content.world, scans: drive.scans, mount: drive.mount, height: drive.height,
    rows: numbers(drive.rows), time: numbers(drive.time), angles: numbers(drive.angles),
    ranges: once(() => numbers(drive.ranges)),
    tilt: drive.tilt && { source: drive.tilt.source, angles: numbers(drive.tilt.angles) },
    truth,
    methods: content.methods.map((method) => readMethod(method, truth)),
  };
}

function readMethod(method, truth) {
  const poses = numbers(method.poses);
  const track = method.track;
  return {
    name: method.name, colour: `--c${method.colour}`, poses, map: method.map, cuts: method.cuts,
    stitches: method.stitches, contradictions: method.contradictions,
    fits: once(() => flags(method.fits)),
    spread: method.spread && { what: method.spread.what, values: numbers(method.spread.values) },
    track: track && {
      verdict: numbers(track.verdict), matches: numbers(track.matches), error: numbers(track.error),
      measures: Object.fromEntries(Object.entries(track.measures).map(([name, column]) => [name, numbers(column)])),
    },
    submaps: method.submaps.map((submap) => ({ ...submap, points: once(() => numbers(submap.points)) })),
    off: once(() => truth && distances(poses, truth)),
  };
}

function distances(poses, truth) {
  return Float32Array.from({ length: poses.length / 3 },
    (_, k) => Math.hypot(poses[3 * k] - truth[3 * k], poses[3 * k + 1] - truth[3 * k + 1]));
}

const poseAt = (poses, k) => [poses[3 * k], poses[3 * k + 1], poses[3 * k + 2]];

// Which of the shown scans is nearest to a scan of the recording.
function shownNear(run, scan) {
  let low = 0, high = run.rows.length - 1;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (run.rows[middle] < scan) low = middle + 1; else high = middle;
  }
  return low;
}
