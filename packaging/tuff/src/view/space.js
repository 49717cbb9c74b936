// The path of a pixel over the maps, its binding table, and the boxes of structures in space.

const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const along = (from, direction, t) => from.map((start, axis) => start + direction[axis] * t);
const isFinite3 = (point) => point.every((number) => typeof number === "number" && Number.isFinite(number));

// The tangent of the angle at which a line (origin, direction) passes a point; infinite behind it.
function angleTo(line, point) {
  const [origin, direction] = line;
  const far = minus(point, origin);
  const forward = dot(far, direction) / Math.sqrt(dot(direction, direction));
  const beside = Math.max(dot(far, far) - forward * forward, 0);
  if (!(forward > 0)) {
    return dot(far, far) === 0 ? 0 : Infinity;
  }
  return Math.sqrt(beside) / forward;
}

// The ends of a path's rays. One that misses has none.
function endsOf(path) {
  return path.rays.map((ray) => {
    const from = isFinite3(ray.origin) ? ray.origin : null;
    const isHit = from && ray.hit && isFinite3([...ray.direction, ray.hit.t]);
    return { from, to: isHit ? along(from, ray.direction, ray.hit.t) : null, ray };
  });
}

// Where a point is seen: the place of the first ray that passes it at the least angle, unless
// another first ray next to that one is nearer to that one than the point is.
function placeOf(point, first, lines) {
  const [width, height] = first.size;
  const layer = width * height * 6 * Math.floor(state.layer / first.step[2]);
  const line = (x, y) => {
    const at = layer + 6 * (x + y * width);
    return [lines.subarray(at, at + 3), lines.subarray(at + 3, at + 6)];
  };
  let [place, angle] = [-1, Infinity];
  for (let i = 0; i < width * height; i++) {
    const at = layer + 6 * i;
    const found = angleTo([lines.subarray(at, at + 3), lines.subarray(at + 3, at + 6)], point);
    if (found < angle) {
      [place, angle] = [i, found];
    }
  }
  if (place < 0) {
    return null;
  }
  const best = [place % width, Math.floor(place / width)];
  const [origin, direction] = line(...best);
  const far = minus(point, origin);
  const length = Math.sqrt(dot(far, far));
  let spacing = 0;
  for (const [right, down] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    const [x, y] = [best[0] + right, best[1] + down];
    if (x >= 0 && y >= 0 && x < width && y < height) {
      const [start, way] = line(x, y);
      const there = along([...start], way, length / Math.sqrt(dot(way, way)));
      const apart = angleTo([origin, direction], there);
      spacing = Number.isFinite(apart) ? Math.max(spacing, apart) : spacing;
    }
  }
  return angle <= spacing ? [best[0] * first.step[0], best[1] * first.step[1]] : null;
}

// Where the ends of a path's rays are seen. The first ray starts at the eye, so it is a point: the
// pixel of the path.
async function placesOf(path, command) {
  const first = command.first_rays;
  if (!first) {
    return [];
  }
  const lines = await floats(first.file);
  const pixel = path.invocation.slice(0, 2).map((at, axis) => Math.round((at - command.first[axis]) / command.step[axis]));
  return endsOf(path).map(({ from, to }, i) => {
    const seen = (point) => point && placeOf(point, first, lines);
    return i === 0 ? { from: pixel, to: to ? pixel : null } : { from: seen(from), to: seen(to) };
  });
}

// The shaders of a group.
function groupText(group) {
  const shaders = ["general", "closest_hit", "any_hit", "intersection"].map((kind) => group[kind]);
  const text = ({ stage, name, file }) => `${stage} shader${name ? ` “${name}”` : ""}${file ? ` of ${file}` : ""}`;
  return `group ${group.group}: ${shaders.filter(Boolean).map(text).join(", ") || "no shaders"}`;
}

// The binding table as the command read it.
function tableOf(path) {
  return Object.entries(path.table ?? {}).map(([name, region]) => {
    const details = document.createElement("details");
    const summary = document.createElement("summary");
    summary.textContent = `${name} region at ${region.address}: ${region.record_count} records, stride ${region.stride}, size ${region.size}`;
    const lines = region.records.map((record) => {
      const holds = record.group ? groupText(record.group) : record.names;
      const used = record.used ? `candidates: ${record.candidates}, calls: ${record.calls}` : "never looked up";
      return `record ${record.index}: ${holds} (${used})`;
    });
    const between = region.handles_between_records ?? [];
    lines.push(...between.map(({ offset, group }) => `byte ${offset}: ${groupText(group)}, but no record begins there`));
    lines.push(...(region.outside ?? []).map(({ index }) => `record ${index} is looked up, past the end`));
    const list = document.createElement("ul");
    list.append(...lines.map((line) => cell(line, "li")));
    details.append(summary, list);
    return details;
  });
}

const PATH_COLOURS = ["#ffffff", "#e69f00", "#56b4e9", "#009e73", "#f0e442", "#d55e00", "#cc79a7"];
const pathColour = (i) => PATH_COLOURS[i % PATH_COLOURS.length];

// A line with a dark edge, which is seen on any colour.
function strokeLine(context, [x0, y0], [x1, y1], colour, dashed) {
  context.setLineDash(dashed ? [5, 5] : []);
  for (const [width, style] of [[4, "#000"], [2, colour]]) {
    context.lineWidth = width;
    context.strokeStyle = style;
    context.beginPath();
    context.moveTo(x0, y0);
    context.lineTo(x1, y1);
    context.stroke();
  }
  context.setLineDash([]);
}

function label(context, text, [x, y]) {
  context.font = "bold 13px system-ui, sans-serif";
  context.lineWidth = 3;
  context.strokeStyle = "#000";
  context.strokeText(text, x + 5, y - 5);
  context.fillStyle = "#fff";
  context.fillText(text, x + 5, y - 5);
}

// Draws the path over a map.
function drawPath(context) {
  const { x, y, zoom } = state.view;
  const at = ([column, row]) => [(column + 0.5 - x) * zoom, (row + 0.5 - y) * zoom];
  state.places.forEach(({ from, to }, i) => {
    if (from && to) {
      strokeLine(context, at(from), at(to), pathColour(i), false);
      label(context, String(i), at(to));
    }
  });
}

// The boxes that are shown: turned by two angles, about the middle of all.
const space = { structures: [], structure: null, level: 1, boxes: null, yaw: 0.6, pitch: 0.4, zoom: 1 };

function boxesOf(structure) {
  return structure.boxes ? [structure] : [];
}

// Lists the structures with boxes.
function showBoxes() {
  const tops = state.command.structures ?? [];
  space.structures = tops.flatMap((top) => [
    ...boxesOf(top).map((structure) => ({ structure, name: `top level ${top.address}: the world`, isTop: true })),
    ...[...top.bottom_levels]
      .sort((a, b) => b.bytes - a.bytes)
      .flatMap(boxesOf)
      .map((structure) => ({ structure, name: `bottom level ${structure.address}: ${structure.kind}`, isTop: false })),
  ]);
  find("space-section").hidden = space.structures.length === 0;
  find("space-structure").replaceChildren(...space.structures.map(({ name }, i) => new Option(name, i)));
  chooseBoxes(0);
}

async function chooseBoxes(index) {
  const chosen = space.structures[index];
  Object.assign(space, { structure: chosen ?? null, level: 1, boxes: null, zoom: 1 });
  if (!chosen) {
    return;
  }
  const { file, levels } = chosen.structure.boxes;
  // The deepest level whose boxes can be told apart.
  const few = levels.findLastIndex((level) => level.boxes <= 256);
  space.level = Math.max(few + 1, 1);
  find("space-level").max = levels.length;
  find("space-level").value = space.level;
  const boxes = await floats(file);
  if (space.structure === chosen) {
    space.boxes = boxes;
    drawSpace();
  }
}

function chooseLevel(level) {
  const last = space.structure?.structure.boxes.levels.length ?? 1;
  space.level = Math.min(Math.max(Math.floor(level) || 1, 1), last);
  find("space-level").value = space.level;
  drawSpace();
}

// Boxes of the level, six numbers each.
function boxesOfLevel() {
  const levels = space.structure.structure.boxes.levels;
  const kept = (from, to) => levels.slice(from, to).reduce((sum, level) => sum + level.kept, 0);
  return space.boxes.subarray(6 * kept(0, space.level - 1), 6 * kept(0, space.level));
}

const EDGES = [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

// Draws the boxes, and the path where they are the world's.
function drawSpace() {
  const canvas = find("space");
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, canvas.width, canvas.height);
  if (!space.structure || !space.boxes) {
    return;
  }
  const all = space.boxes.subarray(0, 6 * space.structure.structure.boxes.levels[0].kept);
  const [least, most] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  for (let i = 0; i < all.length; i++) {
    const axis = i % 3;
    least[axis] = Math.min(least[axis], all[i]);
    most[axis] = Math.max(most[axis], all[i]);
  }
  const middle = least.map((c, axis) => (c + most[axis]) / 2);
  const size = minus(most, least);
  const scale = (space.zoom * 0.9 * Math.min(canvas.width, canvas.height)) / (Math.sqrt(dot(size, size)) || 1);
  const [sy, cy, sp, cp] = [Math.sin(space.yaw), Math.cos(space.yaw), Math.sin(space.pitch), Math.cos(space.pitch)];
  const screen = (point) => {
    const [x, y, z] = minus(point, middle);
    const [right, deep] = [cy * x + sy * z, cy * z - sy * x];
    return [canvas.width / 2 + scale * right, canvas.height / 2 - scale * (cp * y - sp * deep)];
  };
  const boxes = boxesOfLevel();
  context.strokeStyle = "#8fc7ff";
  context.globalAlpha = boxes.length > 6 * 200 ? 0.35 : 0.7;
  context.lineWidth = 1;
  context.beginPath();
  for (let i = 0; i < boxes.length; i += 6) {
    const corner = (c) => screen([0, 1, 2].map((axis) => boxes[i + axis + 3 * ((c >> axis) & 1)]));
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map(corner);
    for (const [a, b] of EDGES) {
      context.moveTo(...corners[a]);
      context.lineTo(...corners[b]);
    }
  }
  context.stroke();
  context.globalAlpha = 1;
  const level = space.structure.structure.boxes.levels[space.level - 1];
  const shown = level.kept < level.boxes ? `${number(level.kept)} of ${number(level.boxes)}` : number(level.boxes);
  const boxesTold = level.boxes === 1 ? "1 box" : `${shown} boxes`;
  const levelsTold = space.level === 1 ? "1 level" : `${space.level} levels`;
  let told = `${boxesTold}, ${levelsTold} below the root of ${space.structure.name}`;
  if (space.structure.isTop && state.path) {
    const ends = endsOf(state.path);
    ends.forEach(({ from, to, ray }, i) => {
      if (from && (to || isFinite3(ray.direction))) {
        const length = Math.sqrt(dot(size, size)) / (Math.sqrt(dot(ray.direction, ray.direction)) || 1);
        const end = to ?? along(from, ray.direction, length);
        strokeLine(context, screen(from), screen(end), pathColour(i), !to);
        label(context, String(i), screen(end));
      }
    });
    told += `, and ${ends.length} rays of the path; those that miss are dashed`;
  }
  find("space-told").textContent = `${told}.`;
  canvas.setAttribute("aria-label", told);
}

function listenToSpace() {
  const canvas = find("space");
  let drag = null;
  const turn = (right, down) => {
    space.yaw += right;
    space.pitch = Math.min(Math.max(space.pitch + down, -Math.PI / 2), Math.PI / 2);
    drawSpace();
  };
  const zoomBy = (factor) => {
    space.zoom = Math.min(Math.max(space.zoom * factor, 0.1), 100);
    drawSpace();
  };
  canvas.addEventListener("pointerdown", (event) => {
    drag = [event.clientX, event.clientY];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (drag) {
      turn((event.clientX - drag[0]) / 150, (event.clientY - drag[1]) / 150);
      drag = [event.clientX, event.clientY];
    }
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, () => {
      drag = null;
    });
  }
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      zoomBy(event.deltaY < 0 ? 1.25 : 0.8);
    },
    { passive: false },
  );
  canvas.addEventListener("keydown", (event) => {
    const turns = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
    if (turns[event.key]) {
      turn(...turns[event.key]);
    } else if (event.key === "+" || event.key === "=") {
      zoomBy(1.25);
    } else if (event.key === "-") {
      zoomBy(0.8);
    } else if (event.key === "Home") {
      Object.assign(space, { yaw: 0.6, pitch: 0.4, zoom: 1 });
      drawSpace();
    } else if (event.key === "PageUp" || event.key === "PageDown") {
      chooseLevel(space.level + (event.key === "PageUp" ? -1 : 1));
    } else {
      return;
    }
    event.preventDefault();
  });
  find("space-structure").addEventListener("change", (event) => chooseBoxes(event.target.value));
  find("space-level").addEventListener("change", (event) => chooseLevel(event.target.valueAsNumber));
}
