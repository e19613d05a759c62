// The fleet's page: it requests the data that it shows every five seconds.
import {ask, button, byId, draw, follow, make, put, short} from "./common.js"

const EVERY_MS = 5000, COUNT = 50
const view = {sort: "device", order: "up", words: "", begin: 0, sensor: location.hash.slice(1)}
let summary = null

const json = async (path, parameters) => (await ask(path, parameters)).json()
const link = device => make("a", {href: `#${encodeURIComponent(device)}`}, device)
const text = (tag, words, attributes = {}) => make(tag, attributes, words)

function plusMinus(value, std) {  // the number after ± is the half-width of the 95 % interval, as in records/plus_minus.py
  const half = 1.96 * std, places = Math.min(9, Math.max(0, 1 - Math.floor(Math.log10(half))))
  return `${value.toFixed(places)} ± ${half.toFixed(places)}`.replace("-", "\u2212")
}

function ago(seconds) {
  if (seconds < 120) return `${Math.round(seconds)} s`
  if (seconds < 7200) return `${Math.round(seconds / 60)} min`
  return seconds < 172800 ? `${Math.round(seconds / 3600)} h` : `${Math.round(seconds / 86400)} d`
}

function showSummary() {
  put(byId("connection"), summary.connected ? "connected to the broker" : "the broker is away; it is tried again")
  byId("connection").dataset.level = summary.connected ? "good" : "bad"
  const tiles = [["sensors", summary.sensors, ""]]
  for (const [state, count] of Object.entries(summary.states)) tiles.push([state, count, `state:${state}`])
  for (const [verdict, count] of Object.entries(summary.sensors_by_verdict)) {
    const axes = summary.axes[verdict]
    tiles.push([axes ? `${verdict}, ${axes.toLocaleString("en")} axes` : verdict, count, `verdict:"${verdict}"`])
  }
  tiles.push(["odd figures", summary.odd_count, "odd"])
  // unchanged tiles are not replaced, so that the focus stays where it is
  if (byId("tiles").dataset.shown !== JSON.stringify(tiles)) {
    byId("tiles").dataset.shown = JSON.stringify(tiles)
    byId("tiles").replaceChildren(...tiles.map(([name, count, words]) => {
      const tile = button("", () => { byId("words").value = words; search(words) }, {class: "tile"})
      tile.append(make("b", {}, count.toLocaleString("en")), name)
      return tile
    }))
  }
  const troubles = []
  if (summary.refused)
    troubles.push(`${summary.refused} messages from names that are not sensors, or beyond the limit, such as ${summary.refused_names.join(", ")}`)
  if (summary.alerts_dropped) troubles.push(`${summary.alerts_dropped} alerts had no room`)
  for (const [reason, count] of Object.entries(summary.bad_messages)) troubles.push(`${count} messages of bad ${reason}`)
  if (summary.flooding.length) troubles.push(`too many messages from ${summary.flooding.join(", ")}`)
  if (summary.twins.length) troubles.push(`two programs under one name: ${summary.twins.join(", ")}`)
  if (summary.history.trouble) troubles.push(summary.history.trouble)
  if (summary.history.lost) troubles.push(`${summary.history.lost} rows of history are lost`)
  put(byId("troubles"), troubles.join("; "))
  const odd = summary.odd.slice(0, 30).map(one => make("li", {}, link(one.device_id),
    ` ${one.axis}: ${one.quantity} ${short(one.value)} ${one.unit}, ${Math.abs(one.times).toFixed(1)} deviations `
    + `${one.value > one.middle ? "above" : "below"} the usual ${short(one.middle)} (${one.kind})`))
  if (summary.odd_count > odd.length) odd.push(text("li", `and ${summary.odd_count - odd.length} more: search for odd`))
  byId("odd").replaceChildren(...odd.length ? odd : [text("li", "nobody")])
  const names = summary.groups.map(group => group.join(" | ")), select = byId("group"), chosen = select.value
  if (names.join() !== [...select.options].map(option => option.value).join()) {
    select.replaceChildren(...names.map(name => text("option", name, {value: name})))
    if (names.includes(chosen)) select.value = chosen
  }
}

async function showDistribution() {
  const group = summary.groups.find(one => one.join(" | ") === byId("group").value)
  if (!group) {
    byId("distribution").replaceChildren(text("p", "Eight sensors of a kind are needed.", {class: "soft"}))
    return
  }
  const [kind, axis, quantity] = group
  const found = await json("api/distribution", {kind, axis, quantity})
  const of = summary.quantities.find(one => one.name === quantity).log ? Math.log10 : x => x
  const points = found.points.filter(point => Number.isFinite(of(point.value)))
  const width = byId("distribution").clientWidth, wide = width - 60
  const svg = make("svg:svg", {viewBox: `0 0 ${width} 210`, role: "img", "aria-label": `${quantity} of ${points.length} sensors`})
  if (points.length) {
    const values = points.map(point => of(point.value)), least = Math.min(...values), span = Math.max(...values) - least || 1
    const x = value => 30 + (of(value) - least) / span * wide
    const bins = new Array(60).fill(0)
    for (const point of points) bins[Math.min(59, Math.floor((x(point.value) - 30) / wide * 60))] += 1
    bins.forEach((count, i) => {
      const height = count / Math.max(...bins) * 150
      svg.append(make("svg:rect", {class: "bar", x: 30 + i * (wide / 60), y: 180 - height, width: wide / 60 - 1, height}))
    })
    for (const point of points.filter(one => one.odd))
      svg.append(make("svg:circle", {class: "odd", cx: x(point.value), cy: 172, r: 5},
        make("svg:title", {}, `${point.device}: ${short(point.value)}`)))
    for (const point of new Set([points[0], points[Math.floor(points.length / 2)], points.at(-1)]))
      svg.append(make("svg:text", {x: x(point.value), y: 200, "text-anchor": "middle"}, short(point.value)))
  }
  byId("distribution").replaceChildren(svg)
}

function showHead() {
  const head = make("tr")
  for (const column of summary.columns) {
    const isSorted = column === view.sort, up = view.order === "up"
    const cell = make("th", {scope: "col", "aria-sort": isSorted ? (up ? "ascending" : "descending") : "none"})
    cell.append(button(column.replace("_s", " [s]") + (isSorted ? (up ? " ▲" : " ▼") : ""), () => {
      Object.assign(view, {order: isSorted && up ? "down" : "up", sort: column, begin: 0})
      showHead()
      refresh()
    }))
    head.append(cell)
  }
  byId("table").tHead.replaceChildren(head)
}

async function showTable() {
  const {sort, order, words, begin} = view
  const found = await json("api/table", {sort, order, words, begin, count: COUNT})
  if (!byId("table").tHead.rows.length) showHead()
  byId("table").tBodies[0].replaceChildren(...found.rows.map(row => make("tr", {}, ...summary.columns.map(column => {
    const value = row[column], isNumber = typeof value === "number"
    if (column === "device") return make("td", {}, link(value))
    const words = column === "bias" && value !== null ? plusMinus(value, row.bias_std) : isNumber ? short(value) : value ?? ""
    return text("td", words, isNumber ? {class: "number"} : {})
  }))))
  const end = Math.min(begin + COUNT, found.total)
  put(byId("total"), found.total ? `${begin + 1} to ${end} of ${found.total.toLocaleString("en")}` : "none")
  byId("earlier").disabled = begin === 0
  byId("later").disabled = end >= found.total
}

// Return a drawing of a quantity over time; text if the history has fewer than two values.
function course(history, axis, {name, log}, figures) {
  const rows = history.filter(row => row.axis === axis && row[name] !== null && (!log || row[`${name}_low`] > 0))
  const column = suffix => rows.map(row => row[name + suffix])
  const of = ([value, low, high]) => `${name}: ${short(value)} (${short(low)} to ${short(high)})`
  if (rows.length < 2) return figures[name] ? [text("p", of(figures[name]))] : []
  const x = rows.map(row => row.unix_s * 1000), last = rows.at(-1)
  const svg = make("svg:svg", {role: "img", "aria-label": `${name} of ${axis} over time`})
  const lines = [{x, y: column(""), low: column("_low"), high: column("_high"), kind: "estimate"}]
  requestAnimationFrame(() => draw(svg, {lines, from: x[0], to: x.at(-1), log}))
  return [make("figure", {}, make("figcaption", {}, text("p", of([last[name], last[`${name}_low`], last[`${name}_high`]]))), svg)]
}

async function showSensor() {
  byId("sensor").hidden = !view.sensor
  if (!view.sensor) return
  let device = "", found
  try { device = decodeURIComponent(view.sensor) } catch { return }
  put(byId("sensor-head"), device)
  try { found = await json("api/sensor", {device}) } catch (error) {
    if (error instanceof TypeError) throw error
    byId("sensor-body").replaceChildren(text("p", "There is no such sensor."))
    return
  }
  const parts = [text("p", `${found.kind}; ${found.state}; heard ${ago(found.heard_s)} ago; `
    + `${found.delivered} samples, ${found.lost} lost; ${found.messages} messages`)]
  for (const [name, axis] of Object.entries(found.axes))
    parts.push(text("h3", `${name}: ${axis.verdict}`), text("p", axis.text),
      ...summary.quantities.flatMap(quantity => course(found.history, name, quantity, axis.figures)))
  if (found.errors.length)
    parts.push(text("h3", "Its last errors"), make("ul", {}, ...found.errors.map(([age, kind, words]) =>
      text("li", `${ago(age)} ago: ${kind}: ${words}`))))
  byId("sensor-body").replaceChildren(...parts)
}

async function showAlerts() {
  const found = await json("api/alerts")
  const items = found.slice(0, 50).map(one => text("li", `${new Date(one.unix_s * 1000).toLocaleString()} ${one.state}: ${one.text}`,
    one.state === "raised" ? {"data-level": "bad"} : {}))
  byId("alerts").replaceChildren(...items.length ? items : [text("li", "none")])
}

const refresh = follow(async () => {
  summary = await json("api/summary")
  showSummary()
  await Promise.all([showDistribution(), showTable(), showSensor(), showAlerts()])
  document.body.dataset.ready = "yes"
}, EVERY_MS)

function search(words) {
  Object.assign(view, {words, begin: 0})
  refresh()
}

let typing = 0
byId("words").addEventListener("input", event => {
  clearTimeout(typing)
  typing = setTimeout(() => search(event.target.value), 250)
})
byId("earlier").addEventListener("click", () => { view.begin = Math.max(0, view.begin - COUNT); refresh() })
byId("later").addEventListener("click", () => { view.begin += COUNT; refresh() })
byId("group").addEventListener("change", refresh)
byId("close").addEventListener("click", () => { location.hash = "" })
addEventListener("hashchange", async () => {
  view.sensor = location.hash.slice(1)
  await showSensor()
  if (view.sensor) byId("sensor").scrollIntoView()
})
