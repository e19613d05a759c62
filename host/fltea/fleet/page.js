"use strict";
// Everything that sensors say is put into the page as text (textContent), never as HTML.
const EVERY_MS = 5000;
const COUNT = 50;
const view = { sort: "device", order: "up", words: "", begin: 0, group: "", sensor: location.hash.slice(1) };
let summary = null;

const $ = (id) => document.getElementById(id);

function make(tag, text, attributes = {}) {
  const node = document.createElement(tag);
  if (text !== undefined) node.textContent = text;
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  return node;
}

function draw(tag, attributes, text) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  if (text !== undefined) node.textContent = text;
  return node;
}

async function ask(path, parameters = {}) {
  const answer = await fetch(`${path}?${new URLSearchParams(parameters)}`, { cache: "no-store" });
  if (!answer.ok) throw new Error(`${path}: ${answer.status}`);
  return answer.json();
}

const short = (value) => (value === null || value === undefined ? "" : Number(value.toPrecision(4)).toString());

function withStd(value, std) {
  const places = Math.min(9, Math.max(0, 1 - Math.floor(Math.log10(std))));
  return `${value.toFixed(places)} ± ${std.toFixed(places)}`;
}

function ago(seconds) {
  if (seconds < 120) return `${Math.round(seconds)} s`;
  if (seconds < 7200) return `${Math.round(seconds / 60)} min`;
  return seconds < 172800 ? `${Math.round(seconds / 3600)} h` : `${Math.round(seconds / 86400)} d`;
}

function link(device) {
  return make("a", device, { href: `#${encodeURIComponent(device)}` });
}

function showSummary() {
  $("connection").textContent = summary.connected ? "connected to the broker" : "the broker is away; it is tried again";
  $("connection").className = summary.connected ? "good" : "bad";
  const tiles = [["sensors", summary.sensors, ""]];
  for (const [state, count] of Object.entries(summary.states)) tiles.push([state, count, `state:${state}`]);
  for (const [verdict, count] of Object.entries(summary.sensors_by_verdict)) {
    const axes = summary.axes[verdict];
    tiles.push([axes ? `${verdict}, ${axes.toLocaleString("en")} axes` : verdict, count, `verdict:"${verdict}"`]);
  }
  tiles.push(["odd figures", summary.odd_count, "odd"]);
  $("tiles").replaceChildren(...tiles.map(([name, count, words]) => {
    const tile = make("button", undefined, { class: "tile", type: "button" });
    tile.append(make("b", count.toLocaleString("en")), name);
    tile.addEventListener("click", () => { $("words").value = words; search(words); });
    return tile;
  }));
  const troubles = [];
  if (summary.refused) {
    troubles.push(`${summary.refused} messages of names that are no sensors, or beyond the limit, such as ${summary.refused_names.join(", ")}`);
  }
  if (summary.alerts_dropped) troubles.push(`${summary.alerts_dropped} alerts had no room`);
  for (const [reason, count] of Object.entries(summary.bad_messages)) troubles.push(`${count} messages of bad ${reason}`);
  if (summary.flooding.length) troubles.push(`too many messages from ${summary.flooding.join(", ")}`);
  if (summary.twins.length) troubles.push(`two programs under one name: ${summary.twins.join(", ")}`);
  if (summary.history.trouble) troubles.push(summary.history.trouble);
  if (summary.history.lost) troubles.push(`${summary.history.lost} rows of history are lost`);
  $("troubles").textContent = troubles.join("; ");
  const odd = summary.odd.slice(0, 30).map((one) => {
    const item = make("li");
    const side = one.value > one.middle ? "above" : "below";
    item.append(link(one.device_id), ` ${one.axis}: ${one.quantity} ${short(one.value)} ${one.unit}, `
      + `${Math.abs(one.times).toFixed(1)} deviations ${side} the usual ${short(one.middle)} (${one.kind})`);
    return item;
  });
  if (summary.odd_count > odd.length) odd.push(make("li", `and ${summary.odd_count - odd.length} more: search for odd`));
  $("odd").replaceChildren(...(odd.length ? odd : [make("li", "nobody")]));
  const names = summary.groups.map((group) => group.join(" | "));
  const select = $("group");
  if (names.join() !== [...select.options].map((option) => option.value).join()) {
    select.replaceChildren(...names.map((name) => make("option", name, { value: name })));
    if (names.includes(view.group)) select.value = view.group;
  }
}

function scale(values, log, low, high) {
  const of = log ? Math.log10 : (x) => x;
  const least = Math.min(...values.map(of));
  const most = Math.max(...values.map(of));
  const span = most - least || 1;
  return (x) => low + ((of(x) - least) / span) * (high - low);
}

async function showDistribution() {
  const group = summary.groups.find((one) => one.join(" | ") === $("group").value);
  if (!group) {
    $("distribution").replaceChildren(make("p", "Eight sensors of a kind are needed.", { class: "hint" }));
    return;
  }
  const [kind, axis, quantity] = group;
  const found = await ask("api/distribution", { kind, axis, quantity });
  const log = summary.quantities.find((one) => one.name === quantity).log;
  const points = found.points.filter((point) => !log || point.value > 0);
  const svg = draw("svg", { viewBox: "0 0 1000 220", role: "img",
    "aria-label": `${quantity} of ${points.length} sensors` });
  if (points.length) {
    const x = scale(points.map((point) => point.value), log, 30, 970);
    const bins = new Array(60).fill(0);
    for (const point of points) bins[Math.min(59, Math.floor(((x(point.value) - 30) / 940) * 60))] += 1;
    const tallest = Math.max(...bins);
    bins.forEach((count, i) => {
      const height = (count / tallest) * 150;
      svg.append(draw("rect", { class: "bar", x: 30 + i * (940 / 60), y: 180 - height, width: 940 / 60 - 1, height }));
    });
    for (const point of points.filter((one) => one.odd)) {
      const dot = draw("circle", { class: "dot odd", cx: x(point.value), cy: 172, r: 5 });
      dot.append(draw("title", {}, `${point.device}: ${short(point.value)}`));
      svg.append(dot);
    }
    svg.append(draw("line", { class: "axis", x1: 30, x2: 970, y1: 180, y2: 180 }));
    const marks = new Set([points[0], points[Math.floor(points.length / 2)], points[points.length - 1]]);
    for (const point of marks) {
      svg.append(draw("text", { x: x(point.value), y: 200, "text-anchor": "middle" }, short(point.value)));
    }
  }
  $("distribution").replaceChildren(svg);
}

async function showTable() {
  const found = await ask("api/table", { sort: view.sort, order: view.order, words: view.words, begin: view.begin, count: COUNT });
  const head = make("tr");
  for (const column of summary.columns) {
    const mark = column === view.sort ? (view.order === "up" ? " ▲" : " ▼") : "";
    const button = make("button", column.replace("_s", " [s]") + mark, { type: "button" });
    button.addEventListener("click", () => {
      view.order = column === view.sort && view.order === "up" ? "down" : "up";
      view.sort = column;
      view.begin = 0;
      refresh();
    });
    const cell = make("th", undefined, { scope: "col" });
    cell.append(button);
    head.append(cell);
  }
  $("table").tHead.replaceChildren(head);
  $("table").tBodies[0].replaceChildren(...found.rows.map((row) => {
    const line = make("tr");
    for (const column of summary.columns) {
      const value = row[column];
      const cell = make("td", undefined, typeof value === "number" ? { class: "number" } : {});
      if (column === "device") cell.append(link(value));
      else if (column === "bias" && value !== null) cell.textContent = withStd(value, row.bias_std);
      else cell.textContent = typeof value === "number" ? short(value) : value;
      line.append(cell);
    }
    return line;
  }));
  const end = Math.min(view.begin + COUNT, found.total);
  $("total").textContent = found.total ? `${view.begin + 1} to ${end} of ${found.total.toLocaleString("en")}` : "none";
  $("earlier").disabled = view.begin === 0;
  $("later").disabled = end >= found.total;
}

function curve(history, axis, quantity, log) {
  const rows = history.filter((row) => row.axis === axis && row[quantity] !== null
    && (!log || row[`${quantity}_low`] > 0));
  if (rows.length < 2) return null;
  const x = scale(rows.map((row) => row.unix_s), false, 60, 970);
  const y = scale(rows.flatMap((row) => [row[`${quantity}_low`], row[`${quantity}_high`]]), log, 190, 20);
  const svg = draw("svg", { viewBox: "0 0 1000 220", role: "img",
    "aria-label": `${quantity} of ${axis} over time` });
  const upper = rows.map((row) => `${x(row.unix_s)},${y(row[`${quantity}_high`])}`);
  const lower = rows.map((row) => `${x(row.unix_s)},${y(row[`${quantity}_low`])}`).reverse();
  svg.append(draw("polygon", { class: "band", points: [...upper, ...lower].join(" ") }));
  svg.append(draw("polyline", { class: "curve", points: rows.map((row) => `${x(row.unix_s)},${y(row[quantity])}`).join(" ") }));
  const last = rows[rows.length - 1];
  svg.append(draw("text", { x: 60, y: 14 }, `${quantity}: ${short(last[quantity])} (${short(last[`${quantity}_low`])} to ${short(last[`${quantity}_high`])})`));
  for (const row of [rows[0], last]) {
    const time = new Date(row.unix_s * 1000).toLocaleString();
    svg.append(draw("text", { x: x(row.unix_s), y: 212, "text-anchor": row === last ? "end" : "start" }, time));
  }
  return svg;
}

async function showSensor() {
  const box = $("sensor");
  box.hidden = !view.sensor;
  if (!view.sensor) return;
  let device = "";
  try { device = decodeURIComponent(view.sensor); } catch { return; }
  $("sensor-head").textContent = device;
  let found;
  try {
    found = await ask("api/sensor", { device });
  } catch {
    $("sensor-body").replaceChildren(make("p", "There is no such sensor."));
    return;
  }
  const parts = [make("p", `${found.kind}; ${found.state}; heard ${ago(found.heard_s)} ago; `
    + `${found.delivered} samples, ${found.lost} lost; ${found.messages} messages`)];
  for (const [name, axis] of Object.entries(found.axes)) {
    parts.push(make("h3", `${name}: ${axis.verdict}`), make("p", axis.text));
    for (const quantity of summary.quantities) {
      const drawn = curve(found.history, name, quantity.name, quantity.log);
      if (drawn) parts.push(drawn);
      else if (axis.figures[quantity.name]) {
        const [value, low, high] = axis.figures[quantity.name];
        parts.push(make("p", `${quantity.name}: ${short(value)} (${short(low)} to ${short(high)})`));
      }
    }
  }
  const errors = make("ul");
  for (const [age, kind, text] of found.errors) errors.append(make("li", `${ago(age)} ago: ${kind}: ${text}`));
  if (found.errors.length) parts.push(make("h3", "Its last errors"), errors);
  $("sensor-body").replaceChildren(...parts);
}

async function showAlerts() {
  const found = await ask("api/alerts");
  const items = found.slice(0, 50).map((one) => make("li",
    `${new Date(one.unix_s * 1000).toLocaleString()} ${one.state}: ${one.text}`, one.state === "raised" ? { class: "bad" } : {}));
  $("alerts").replaceChildren(...(items.length ? items : [make("li", "none")]));
}

let asking = false;
async function refresh() {
  if (asking) return;
  asking = true;
  try {
    summary = await ask("api/summary");
    showSummary();
    await Promise.all([showDistribution(), showTable(), showSensor(), showAlerts()]);
    document.body.dataset.ready = "yes";
  } catch (error) {
    $("connection").textContent = `fltea fleet does not answer (${error.message}); it is asked again`;
    $("connection").className = "bad";
  } finally {
    asking = false;
  }
}

function search(words) {
  view.words = words;
  view.begin = 0;
  refresh();
}

let typing = 0;
$("words").addEventListener("input", (event) => {
  clearTimeout(typing);
  typing = setTimeout(() => search(event.target.value), 250);
});
$("earlier").addEventListener("click", () => { view.begin = Math.max(0, view.begin - COUNT); refresh(); });
$("later").addEventListener("click", () => { view.begin += COUNT; refresh(); });
$("group").addEventListener("change", (event) => { view.group = event.target.value; refresh(); });
$("close").addEventListener("click", () => { location.hash = ""; });
addEventListener("hashchange", () => {
  view.sensor = location.hash.slice(1);
  showSensor().then(() => { if (view.sensor) $("sensor").scrollIntoView({ behavior: "smooth" }); });
});
refresh();
setInterval(refresh, EVERY_MS);
