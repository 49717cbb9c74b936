// The page of a capture. Maps are unpacked when they are first shown. All of them are seen through
// one view: the same part of the launch at the same zoom.

const data = JSON.parse(document.getElementById("data").textContent);
const find = (id) => document.getElementById(id);

// Titles and units of maps.
const TITLES = {
  rays: "Rays",
  steps: "Traversal steps",
  box_tests: "Box tests",
  primitive_tests: "Triangle tests",
  any_hit_candidates: "Any-hit candidates",
  box_candidates: "Intersection candidates",
  depth: "Depth of recursion",
  closest_hit_shaders: "Closest-hit shaders",
  miss_shaders: "Miss shaders",
  callable_shaders: "Callable shaders",
  nan_rays: "Rays with NaN",
  infinite_rays: "Infinite rays",
  any_hit_shaders: "Any-hit shaders",
  intersection_shaders: "Intersection shaders",
  nanoseconds: "Nanoseconds",
  primitives: "Primitives",
  failed_tests: "Failed depth and stencil tests",
  fragment_shaders: "Fragment shaders",
};
const RUN = "the way really taken";
const OF = { ray: "each ray by itself, the same on every machine", run: RUN };
const OF_PASSES = { ray: "each pixel by itself, the same on every machine", run: RUN };
const SHOWN_FIRST = [
  ...["rays", "steps", "primitive_tests", "nanoseconds"],
  ...["primitives", "failed_tests", "fragment_shaders"],
];

// Polynomials in [0, 1], one row a power, one column a channel.
const VIRIDIS = [
  [0.2777273272, 0.0054073445, 0.3340998053],
  [0.1050930431, 1.4046135299, 1.3845901626],
  [-0.3308618287, 0.2148475595, 0.095095163],
  [-4.634230499, -5.7991009734, -19.3324409563],
  [6.2282699363, 14.1799333668, 56.6905526007],
  [4.7763849977, -13.7451453777, -65.3530326334],
  [-5.4354558559, 4.6458526122, 26.3124352496],
];
// Fifths of cividis (Nuñez, Anderton, Renslow 2018), which is joined by lines.
const CIVIDIS = [[0, 34, 78], [53, 69, 108], [102, 105, 112], [148, 142, 119], [200, 184, 102], [254, 232, 56]];

function colour(name, x) {
  if (name === "grey") {
    return [x * 255, x * 255, x * 255];
  }
  if (name === "cividis") {
    const place = x * (CIVIDIS.length - 1);
    const index = Math.min(Math.floor(place), CIVIDIS.length - 2);
    const part = place - index;
    return [0, 1, 2].map((c) => CIVIDIS[index][c] * (1 - part) + CIVIDIS[index + 1][c] * part);
  }
  return [0, 1, 2].map((c) => {
    const value = VIRIDIS.reduceRight((sum, row) => sum * x + row[c], 0);
    return Math.min(Math.max(value, 0), 1) * 255;
  });
}

function table(name) {
  const colours = new Uint8ClampedArray(256 * 3);
  for (let i = 0; i < 256; i++) {
    colours.set(colour(name, i / 255), i * 3);
  }
  return colours;
}

const count = (command) => command.size[0] * command.size[1] * command.size[2];
const number = (value) => value.toLocaleString("en");
// A float of the driver's; those that are not finite are text.
const float = (value) => (typeof value === "number" ? String(Number(value.toPrecision(7))) : value);
const vector = (values) => `(${values.map(float).join(", ")})`;

// Numbers of so many bytes: bytes of each number are in planes, the lowest first.
async function unpack(data, width, length) {
  const values = new Uint32Array(length);
  if (data === null) {
    return values;
  }
  const text = atob(data);
  const packed = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) {
    packed[i] = text.charCodeAt(i);
  }
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  for (let plane = 0; plane < width; plane++) {
    const at = plane * length;
    for (let i = 0; i < length; i++) {
      values[i] |= bytes[at + i] << (8 * plane);
    }
  }
  return values;
}

// The floats of a file.
const floatFiles = new Map();
function floats(name) {
  if (!floatFiles.has(name)) {
    const { data: packed, length } = data.floats[name];
    const words = unpack(packed, 4, length);
    floatFiles.set(name, words.then((values) => new Float32Array(values.buffer)));
  }
  return floatFiles.get(name);
}

function numbersOf(map, command) {
  map.values ??= unpack(map.data, map.width, count(command));
  return map.values;
}

const state = {
  command: null,
  layer: 0,
  shown: new Set(SHOWN_FIRST),
  // The part that is seen: its upper left corner, and screen pixels for each number.
  view: { x: 0, y: 0, zoom: 1, whole: true },
  place: null,
  figures: [],
  // The path that is shown, and where the ends of its rays are seen.
  path: null,
  places: [],
};

// Numbers in ascending order; quickly where few differ, as in most maps.
function sortedNumbers(values) {
  let most = 0;
  for (let i = 0; i < values.length; i++) {
    most = Math.max(most, values[i]);
  }
  if (most >= 1 << 20) {
    return values.slice().sort();
  }
  const counts = new Uint32Array(most + 1);
  for (let i = 0; i < values.length; i++) {
    counts[values[i]]++;
  }
  const sorted = new Uint32Array(values.length);
  let at = 0;
  for (let value = 0; value <= most; value++) {
    sorted.fill(value, at, at + counts[value]);
    at += counts[value];
  }
  return sorted;
}

function sumOf(values) {
  let sum = 0;
  for (let i = 0; i < values.length; i++) {
    sum += values[i];
  }
  return sum;
}

// The place of the first of ascending numbers that is at least some number.
function firstFrom(sorted, number) {
  let [from, to] = [0, sorted.length];
  while (from < to) {
    const middle = (from + to) >> 1;
    if (sorted[middle] < number) {
      from = middle + 1;
    } else {
      to = middle;
    }
  }
  return from;
}

// A map as it is shown.
class Figure {
  constructor(map, command, values) {
    Object.assign(this, { map, command, values });
    const layer = command.size[0] * command.size[1];
    this.layer = values.subarray(layer * state.layer, layer * (state.layer + 1));
    const sorted = sortedNumbers(this.layer);
    this.most = sorted[sorted.length - 1] ?? 0;
    // Few large numbers would leave the others one colour.
    this.end = Math.max(sorted[Math.ceil((sorted.length - 1) * 0.999)] ?? 0, 1);
    this.median = sorted[(sorted.length - 1) >> 1] ?? 0;
    this.sum = sumOf(this.layer);
    this.element = document.createElement("figure");
    this.element.dataset.map = map.name;
    const title = TITLES[map.name] ?? map.name;
    const told = `${title}: ${number(this.sum)} in all, median ${number(this.median)}, most ${number(this.most)}`;
    this.element.innerHTML = `<figcaption><b></b><small></small></figcaption>
      <canvas tabindex="0" role="img"></canvas>
      <div class="scale"><span>0</span><i></i><span></span></div><div class="histogram"></div>`;
    const [name, of] = this.element.querySelectorAll("b, small");
    name.textContent = title;
    const texts = command.kind === "pass" ? OF_PASSES : OF;
    of.textContent = `${number(this.sum)} in all · most ${number(this.most)} · of ${texts[map.of] ?? map.of}`;
    this.element.querySelectorAll(".scale span")[1].textContent =
      this.end < this.most ? `${number(this.end)} and more` : number(this.end);
    this.canvas = this.element.querySelector("canvas");
    this.canvas.setAttribute("aria-label", told);
    this.picture = document.createElement("canvas");
    [this.picture.width, this.picture.height] = command.size;
    this.histogram(sorted);
    listen(this.canvas);
  }

  // Bars of equal parts of the scale. Heights are logarithms: rare numbers show.
  histogram(sorted) {
    const bars = 48;
    const edges = Array.from({ length: bars }, (_, i) => firstFrom(sorted, (i * (this.end + 1)) / bars));
    const counts = edges.map((from, i) => (edges[i + 1] ?? sorted.length) - from);
    const highest = Math.log1p(Math.max(...counts));
    const shapes = counts.map((many, i) => {
      const height = highest > 0 ? (Math.log1p(many) / highest) * 40 : 0;
      const from = Math.ceil((i * (this.end + 1)) / bars);
      return `<rect x="${i * 10}" y="${40 - height}" width="9" height="${height}"><title>from ${from}: ${many}</title></rect>`;
    });
    const place = this.element.querySelector(".histogram");
    place.innerHTML = `<svg viewBox="0 0 ${bars * 10} 40" preserveAspectRatio="none" role="img">${shapes.join("")}</svg>`;
    place.firstChild.setAttribute(
      "aria-label",
      `Histogram: ${number(counts[0])} of ${number(sorted.length)} are in the first of ${bars} parts, median ${number(this.median)}`,
    );
  }

  paint(colours, logarithmic) {
    const [width, height] = this.command.size;
    const image = new ImageData(width, height);
    const words = new Uint32Array(256);
    const bytes = new Uint8Array(words.buffer);
    for (let i = 0; i < 256; i++) {
      bytes.set([colours[3 * i], colours[3 * i + 1], colours[3 * i + 2], 255], 4 * i);
    }
    const pixels = new Uint32Array(image.data.buffer);
    const { layer } = this;
    const scale = 255 / (logarithmic ? Math.log1p(this.end) : this.end);
    for (let i = 0; i < layer.length; i++) {
      const value = logarithmic ? Math.log1p(layer[i]) : layer[i];
      pixels[i] = words[Math.min((value * scale + 0.5) | 0, 255)];
    }
    this.picture.getContext("2d").putImageData(image, 0, 0);
    const stops = [0, 0.25, 0.5, 0.75, 1].map((x) => {
      const at = Math.round(x * 255) * 3;
      return `rgb(${colours[at]},${colours[at + 1]},${colours[at + 2]})`;
    });
    this.element.querySelector(".scale i").style.background = `linear-gradient(to right,${stops.join(",")})`;
  }

  draw() {
    const { x, y, zoom } = state.view;
    const context = this.canvas.getContext("2d");
    context.imageSmoothingEnabled = zoom < 1;
    context.fillStyle = "#777";
    context.fillRect(0, 0, this.canvas.width, this.canvas.height);
    const [width, height] = this.command.size;
    context.drawImage(this.picture, -x * zoom, -y * zoom, width * zoom, height * zoom);
    if (state.place) {
      const [column, row] = state.place;
      const side = Math.max(zoom, 5);
      const left = (column + 0.5 - x) * zoom - side / 2;
      const top = (row + 0.5 - y) * zoom - side / 2;
      context.lineWidth = 3;
      context.strokeStyle = "#000";
      context.strokeRect(left, top, side, side);
      context.lineWidth = 1;
      context.strokeStyle = "#fff";
      context.strokeRect(left, top, side, side);
    }
    drawPath(context);
  }
}

function draw() {
  state.figures.forEach((figure) => figure.draw());
}

// Fits the whole into canvases of their width, or keeps the zoom.
function fit() {
  const [width, height] = state.command.size;
  const first = state.figures[0];
  if (!first) {
    return;
  }
  const across = Math.max(Math.round(first.canvas.clientWidth * devicePixelRatio), 1);
  const down = Math.max(Math.round(Math.min((across * height) / width, across)), Math.min(24, across));
  for (const { canvas } of state.figures) {
    [canvas.width, canvas.height] = [across, down];
  }
  if (state.view.whole) {
    Object.assign(state.view, { x: 0, y: 0, zoom: Math.min(across / width, down / height) });
  }
  draw();
}

// Zooms about a place, which stays where it is.
function zoom(factor, about) {
  const view = state.view;
  const next = Math.min(Math.max(view.zoom * factor, 0.02), 64);
  const [x, y] = about ?? state.place ?? state.command.size.map((size) => size / 2);
  view.x = x - ((x - view.x) * view.zoom) / next;
  view.y = y - ((y - view.y) * view.zoom) / next;
  Object.assign(view, { zoom: next, whole: false });
  draw();
}

function whole() {
  state.view.whole = true;
  fit();
}

// The launch index of a number's place.
function launchIndex([x, y]) {
  const { first, step } = state.command;
  return [x, y, state.layer].map((place, axis) => first[axis] + place * step[axis]);
}

function select(place) {
  const [width, height] = state.command.size;
  state.place = [
    Math.min(Math.max(Math.floor(place[0]), 0), width - 1),
    Math.min(Math.max(Math.floor(place[1]), 0), height - 1),
  ];
  const index = state.place[0] + state.place[1] * width;
  find("place").textContent = `(${launchIndex(state.place).join(", ")})`;
  const rows = state.figures.map((figure) => {
    const title = TITLES[figure.map.name] ?? figure.map.name;
    return `<tr><th scope="row">${title}</th><td data-value="${figure.map.name}">${number(figure.layer[index])}</td></tr>`;
  });
  find("values").innerHTML = `<table>${rows.join("")}</table>`;
  draw();
}

// Shows the path of the selected pixel, or the command that captures it.
async function showPath() {
  const index = launchIndex(state.place);
  const { frame, kind, extent, command } = state.command;
  const captured = data.paths.filter(
    (path) =>
      path.rays &&
      path.frame === frame &&
      path.kind === kind &&
      String(path.extent) === String(extent) &&
      String(path.invocation) === String(index),
  );
  const path = captured.find((one) => one.command === command) ?? captured[0];
  const place = find("path");
  place.replaceChildren();
  state.path = path ?? null;
  state.places = [];
  drawSpace();
  draw();
  if (kind === "pass") {
    place.textContent = "Rays of drawing are counted, and have no path.";
    return;
  }
  if (!path) {
    const told = document.createElement("p");
    told.textContent = `The path of (${index.join(", ")}) is not captured. This captures it; then make the page anew:`;
    const line = document.createElement("pre");
    const program = data.program ?? "PROGRAM";
    line.textContent = `TUFF_CAPTURE_PIXEL=${index.join(",")} TUFF_CAPTURE=${data.folder} TUFF_CAPTURE_FRAMES=${frame} ${program}`;
    place.append(told, line);
    return;
  }
  const list = document.createElement("ol");
  list.start = 0;
  for (const ray of path.rays) {
    const item = document.createElement("li");
    const hit = ray.hit ? `hit at t = ${float(ray.hit.t)}` : "miss";
    const shader = ray.shader ? `, ${ray.shader.stage} shader` : "";
    const record = ray.record === undefined ? "" : `, record ${ray.record}${ray.shader ? "" : ": no shader runs"}`;
    const parent = ray.parent === null ? "" : ` in a shader of ray ${ray.parent}`;
    const interval = ray.t_min === undefined ? "" : `, t from ${float(ray.t_min)} to ${float(ray.t_max)}`;
    const flags = ray.flag_names?.length ? `, ${ray.flag_names.join(", ")}` : "";
    item.textContent = `${ray.instruction}${parent}: from ${vector(ray.origin)} along ${vector(ray.direction)}${interval}${flags}: ${hit}${shader}${record}`;
    const met = document.createElement("ul");
    for (const one of ray.met ?? []) {
      const part = document.createElement("li");
      const t = one.t === null ? "" : `t = ${float(one.t)}: `;
      part.textContent = `${t}${one.primitive_kind} ${one.primitive} of geometry ${one.geometry}, instance ${one.instance}: ${one.outcome}${one.opaque ? " (opaque)" : ""}`;
      met.append(part);
    }
    item.append(met);
    list.append(item);
  }
  const told = document.createElement("p");
  place.append(told, list, ...tableOf(path));
  const places = await placesOf(path, state.command);
  if (state.path !== path) {
    return;
  }
  state.places = places;
  const seen = places.filter((one) => one.from && one.to).length;
  told.textContent = places.length
    ? `${seen} of ${path.rays.length} rays are drawn over the maps, where their ends are seen along the first rays of the launch, also through surfaces; all are drawn among the boxes.`
    : "The first rays of the launch are not captured; the path is drawn among the boxes.";
  places.forEach((one, i) => {
    const text = (at) => (at ? `(${at.join(", ")})` : "outside");
    list.children[i].title = `seen from ${text(one.from)} to ${text(one.to)}`;
  });
  draw();
}

// A cell of a table, or its head.
function cell(text, kind = "td") {
  const made = document.createElement(kind);
  made.textContent = text;
  return made;
}

const milliseconds = (nanoseconds) => `${(nanoseconds / 1e6).toPrecision(3)} ms`;

// The time of a structure's build, if it is known.
function built(structure) {
  const time = structure.build_nanoseconds;
  if (typeof time !== "number") {
    return "";
  }
  return `, ${structure.is_update ? "updated" : "built"} in ${milliseconds(time)}`;
}

const flagsOf = (structure) => (structure.flags?.length ? `, ${structure.flags.join(", ")}` : "");

// Lists the structures that the command's rays name.
function showStructures() {
  const place = find("structures");
  place.replaceChildren();
  for (const top of state.command.structures ?? []) {
    const told = document.createElement("p");
    told.textContent = `Top level at ${top.address}: ${number(top.active_instances)} instances, ${number(top.bytes)} bytes, depth ${top.depth}${built(top)}${flagsOf(top)}${top.left_out_of_file ? `; ${number(top.left_out_of_file)} primitives or instances are not in the file` : ""}. As glTF: ${top.file}`;
    const table = document.createElement("table");
    const head = document.createElement("tr");
    head.append(...["bottom level", "primitives", "instances", "bytes", "depth", "build"].map((text) => cell(text, "th")));
    table.append(head);
    const bottoms = [...top.bottom_levels].sort((a, b) => b.bytes - a.bytes);
    for (const bottom of bottoms.slice(0, 100)) {
      const row = document.createElement("tr");
      row.title = `${bottom.address}, ${bottom.geometries} geometries, ${bottom.nodes} nodes, ${bottom.flags.join(", ") || "no flags"}`;
      const kind = cell(bottom.kind, "th");
      const numbers = [bottom.primitives, bottom.instances, bottom.bytes, bottom.depth];
      const time = bottom.build_nanoseconds;
      row.append(kind, ...numbers.map((value) => cell(number(value))));
      row.append(cell(typeof time === "number" ? milliseconds(time) : "—"));
      table.append(row);
      const flags = document.createElement("tr");
      const all = cell(`${bottom.address}: ${bottom.flags.join(", ") || "no flags"}${bottom.is_update ? ", updated" : ""}`);
      all.colSpan = 6;
      flags.append(all);
      table.append(flags);
    }
    place.append(told, table);
    if (bottoms.length > 100) {
      place.append(cell(`${bottoms.length - 100} smaller ones are in maps.json.`, "p"));
    }
  }
  if (!place.firstChild) {
    place.textContent = "None are known.";
  }
}

// The place under a pointer.
function under(event) {
  const canvas = event.currentTarget;
  const box = canvas.getBoundingClientRect();
  const { x, y, zoom } = state.view;
  return [
    x + ((event.clientX - box.left) * canvas.width) / box.width / zoom,
    y + ((event.clientY - box.top) * canvas.height) / box.height / zoom,
  ];
}

function listen(canvas) {
  let drag = null;
  canvas.addEventListener("pointerdown", (event) => {
    drag = { at: under(event), moved: false };
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    const at = under(event);
    const far = drag && Math.hypot(at[0] - drag.at[0], at[1] - drag.at[1]) * state.view.zoom;
    if (drag && (drag.moved || far > 4)) {
      drag.moved = true;
      state.view.whole = false;
      state.view.x += drag.at[0] - at[0];
      state.view.y += drag.at[1] - at[1];
      draw();
      return;
    }
    select(at);
  });
  canvas.addEventListener("pointerup", (event) => {
    if (drag && !drag.moved) {
      select(under(event));
      showPath();
    }
    drag = null;
  });
  canvas.addEventListener("pointercancel", () => {
    drag = null;
  });
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      zoom(event.deltaY < 0 ? 1.25 : 0.8, under(event));
    },
    { passive: false },
  );
  canvas.addEventListener("keydown", (event) => {
    const far = event.shiftKey ? 10 : 1;
    const moves = { ArrowLeft: [-far, 0], ArrowRight: [far, 0], ArrowUp: [0, -far], ArrowDown: [0, far] };
    const move = moves[event.key];
    const [x, y] = state.place ?? [0, 0];
    if (move) {
      select([x + move[0], y + move[1]]);
    } else if (event.key === "+" || event.key === "=") {
      zoom(1.25);
    } else if (event.key === "-") {
      zoom(0.8);
    } else if (event.key === "Home") {
      whole();
    } else if (event.key === "Enter" || event.key === " ") {
      select([x, y]);
      showPath();
    } else {
      return;
    }
    event.preventDefault();
  });
}

function paint() {
  const colours = table(find("colours").value);
  const logarithmic = find("scale").value === "logarithmic";
  state.figures.forEach((figure) => figure.paint(colours, logarithmic));
  draw();
}

// Shows the chosen maps of the command. A later choice is not overtaken.
let turn = 0;
async function show() {
  const mine = ++turn;
  const command = state.command;
  const maps = command.maps.filter((map) => state.shown.has(map.name));
  const values = await Promise.all(maps.map((map) => numbersOf(map, command)));
  if (mine !== turn) {
    return;
  }
  state.figures = maps.map((map, i) => new Figure(map, command, values[i]));
  find("maps").replaceChildren(...state.figures.map((figure) => figure.element));
  fit();
  paint();
  if (state.place) {
    select(state.place);
  }
  document.body.dataset.ready = String(command.command);
}

function choose(index) {
  const command = data.commands[index];
  Object.assign(state, { command, layer: 0, place: null, path: null, places: [] });
  state.view.whole = true;
  find("place").textContent = "—";
  find("values").replaceChildren();
  find("layer").value = 0;
  find("layer").max = command.size[2] - 1;
  find("layer-label").hidden = command.size[2] < 2;
  const sampled = command.step.some((step) => step > 1)
    ? `The launch of ${command.extent.join(" × ")} is sampled: one invocation in ${command.step.join(" × ")}. `
    : "";
  const stopped = command.stopped ? "The command was stopped. " : "";
  const dropped = data.dropped ? `${data.dropped} later commands are not captured.` : "";
  find("note").textContent = sampled + stopped + dropped;
  const boxes = command.maps.map((map) => {
    const label = document.createElement("label");
    const box = document.createElement("input");
    Object.assign(box, { type: "checkbox", checked: state.shown.has(map.name), value: map.name });
    box.addEventListener("change", () => {
      box.checked ? state.shown.add(map.name) : state.shown.delete(map.name);
      show();
    });
    const empty = map.data === null ? " (zeros)" : "";
    label.append(box, ` ${TITLES[map.name] ?? map.name}${empty}`);
    return label;
  });
  find("shown").replaceChildren(find("shown").firstElementChild, ...boxes);
  showStructures();
  showBoxes();
  show();
}

find("program").textContent = data.program ? `of ${data.program}` : "";
document.title = `Capture ${find("program").textContent}`;
find("controls").addEventListener("submit", (event) => event.preventDefault());
find("command").append(
  ...data.commands.map((command, i) => {
    const of = command.pipeline ? ` of “${command.pipeline}”` : "";
    const name = command.kind === "pass" ? "pass" : "command";
    const what = command.kind === "pass" ? "" : `${command.kind} `;
    const text = `frame ${command.frame}, ${name} ${command.command}: ${what}${command.extent.join(" × ")}${of}`;
    return new Option(text, i);
  }),
);
find("command").addEventListener("change", (event) => choose(event.target.value));
find("layer").addEventListener("change", (event) => {
  const last = state.command.size[2] - 1;
  state.layer = Math.min(Math.max(Math.floor(event.target.valueAsNumber) || 0, 0), last);
  show();
});
find("colours").addEventListener("change", paint);
find("scale").addEventListener("change", paint);
find("closer").addEventListener("click", () => zoom(1.5));
find("farther").addEventListener("click", () => zoom(1 / 1.5));
find("whole").addEventListener("click", whole);
listenToSpace();
addEventListener("resize", () => state.command && fit());
if (data.commands.length > 0) {
  choose(0);
} else {
  find("note").textContent = "No command that traces rays and no pass was captured in the wanted frames.";
}
