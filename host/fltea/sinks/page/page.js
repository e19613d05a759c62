// The live page. Once a second it asks the server for the parts of the page that are open, and gets those
// that have changed.
import {ask, button, byId, clock, draw, follow, make, put} from "./common.js"

const choice = {device: "", axis: "", window: 1, course: false, ...fromHash()}
const has = {}  // for each part of the page, the checksum of the content that it shows
let table = {cursor: "", columns: {}}  // rows of numbers for the diagrams over time of the open axis
let drawn = {cursor: "", columns: {}}  // rows of numbers for the small diagrams of all axes
// a phone has room only for the first small diagram of an axis
const isWide = matchMedia("(min-width: 601px)")
let marks = {steps: [], motion: []}  // steps of the bias and motions of the sensor in the time window
let shown = ""  // device, axis and time window that are shown

function fromHash() {
  const found = new URLSearchParams(location.hash.slice(1))
  return {device: found.get("device") ?? "", axis: found.get("axis") ?? "", course: found.has("course"),
    window: Number(found.get("window") ?? 1)}
}

function choose(change) {
  Object.assign(choice, change)
  const kept = Object.entries(choice).filter(([, value]) => value !== "" && value !== false)
  history.replaceState(null, "", "#" + new URLSearchParams(kept))
  refresh()
}

const refresh = follow(async () => {
  const asked = {...choice}, open = [...document.querySelectorAll("details[data-parts][open]")]
  const parts = ["devices", "now", "axes", "recording", ...open.flatMap(one => one.dataset.parts.split(","))]
  if (asked.axis) parts.push("axis", "curves", ...asked.course ? ["marks"] : [])
  if (isWide.matches) parts.push("spectra")
  const query = {device: asked.device, axis: asked.axis, window: asked.window, drawn: drawn.cursor,
    parts: parts.map(part => `${part}:${has[part] ?? ""}`).join()}
  if (asked.course && asked.axis) query.cursor = table.cursor
  const found = await (await ask("state", query)).json()
  // the user has chosen something else meanwhile, so this answer is not used
  if (["device", "axis", "window", "course"].some(name => asked[name] !== choice[name])) return
  const of = [found.device, found.axis, found.window].join()
  if (of !== shown) {  // the answer is incomplete, since the request contained the checksums of another axis
    const isFirst = !shown
    shown = of
    table.cursor = ""
    if (!isFirst) for (const part in has) delete has[part]
    choice.device = found.device
    choice.window = found.window
    if (!isFirst) { setTimeout(refresh); return }
  }
  for (const [part, [checksum, content]] of Object.entries(found.parts)) {
    has[part] = checksum
    SHOW[part](content)
  }
  document.title = `fltea ${found.device}`
  byId("open").hidden = !found.axis
  for (const card of document.querySelectorAll(".axis")) {
    const isOpen = card.dataset.axis === found.axis
    card.querySelector("button").setAttribute("aria-expanded", isOpen)
    if (isOpen && card.nextSibling !== byId("open")) card.after(byId("open"))
  }
  for (const one of byId("windows").children) one.setAttribute("aria-pressed", Number(one.dataset.window) === found.window)
  drawings(found.drawn)
  if (found.rows) course(found)
}, 1000)

const SHOW = {
  devices(found) {
    const place = byId("devices")
    place.hidden = found.length < 2
    if (place.children.length !== found.length)
      place.replaceChildren(...found.map(one => button(one.name, () => choose({device: one.name, axis: ""}))))
    found.forEach((one, number) => {
      const made = place.children[number]
      made.setAttribute("aria-pressed", one.name === choice.device)
      made.dataset.status = one.level
      made.title = one.text
    })
  },

  now(found) {
    const root = document.documentElement.dataset
    root.seq = found.seq ?? ""
    root.epoch = found.epoch ?? ""
    put(byId("status"), found.status.text)
    byId("status").dataset.level = found.status.level
    // set only when it changes, so that a screen reader does not speak each second
    if (root.told !== `${found.status.level} ${found.epoch}`) {
      root.told = `${found.status.level} ${found.epoch}`
      put(byId("told"), found.status.text)
    }
    put(byId("slow"), found.slow)
    byId("slow").hidden = !found.slow
    const last = found.time_ms === null ? "" : `last sample ${clock(new Date(found.time_ms))}`
    put(byId("about"), [choice.device, found.fit, last].filter(Boolean).join(" · "))
    put(byId("settings"), found.settings)
    put(byId("health"), found.link.text)
    byId("health").dataset.level = found.link.level
    put(byId("happened"), found.happened)
    for (const [id, path] of [["report", "report.html"], ["yaml", "imu.yaml"]]) {
      byId(id).hidden = !found.fit
      byId(id).href = `${path}?device=${encodeURIComponent(choice.device)}`
    }
  },

  axes(found) {
    const place = byId("axes"), names = found.map(axis => axis.name).join()
    if (place.dataset.names !== names) {
      // the details of the open axis are kept: they stand between the axes, but are no axis
      place.append(byId("open"))
      place.dataset.names = names
      delete has.spectra  // ask for the spectra again, since the elements that showed them are replaced
      place.replaceChildren(...found.map(axis => {
        const card = make("div", {class: "card axis", "data-axis": axis.name}, make("h2", {}, axis.name),
          make("p", {}, make("b"), make("span")))
        const words = `${axis.quantity} less its offset [${axis.unit}]`
        const over = make("figure", {class: "rate"}, make("figcaption", {}, words, ...keys([["sample", "samples"], ["state", "bias, 95 %"]])),
          make("svg:svg", {role: "img", "aria-label": `${words}, and bias, ${axis.name}, last 2 minutes`}))
        card.append(button("details", () => choose({axis: choice.axis === axis.name ? "" : axis.name}),
          {"aria-controls": "open", "aria-label": `details of ${axis.name}`}),
          make("div", {class: "drawings"}, over, make("figure", {class: "spectrum"})))
        return card
      }), byId("open"))
    }
    found.forEach(axis => {
      const card = place.querySelector(`[data-axis="${axis.name}"]`)
      card.dataset.kind = axis.kind
      put(card.querySelector("b"), axis.head)
      put(card.querySelector("p span"), axis.rest)
    })
  },

  axis(found) {
    if (!found) return
    byId("text").replaceChildren(...found.text.map(text => make("p", {}, text)),
      ...found.changes.map(([before, time, after]) => make("p", {class: "change"}, upper(`${before}${clock(new Date(time))}${after}.`))))
    rows("coefficients", found.coefficients)
    rows("headings", found.headings)
    for (const name of ["coefficients", "headings"]) byId(`${name}-part`).hidden = !found[name].length
    const board = found.of_board, compared = found.compared
    byId("board").hidden = !board
    put(byId("board"), board ? `The board's own fit: ${board.alpha}; ${board.text}.` : "")
    put(document.querySelector("#open .why-not"), compared ? compared.why_not : "")
    rows("rows", [...found.rows, ...compared ? [["α, device", compared.alpha_text], ["f, device", compared.f_text],
      ["α, device − host", compared.alpha_apart || "–"], ["f, device − host", compared.f_apart || "–"], ...compared.rows] : []])
    put(byId("guard"), [guard("FLTEA's guard", found.guard), guard("the device's guard", compared ? compared.guard : [])]
      .filter(Boolean).join("; "))
    figures(found)
  },

  marks(found) { marks = found ?? {steps: [], motion: []} },

  spectra(found) {
    for (const card of document.querySelectorAll(".axis"))
      card.querySelector(".spectrum").replaceChildren(...found[card.dataset.axis] ? [parse(found[card.dataset.axis])] : [])
  },

  curves(found) {
    byId("curves").replaceChildren(...found.map(text => make("figure", {}, parse(text))))
    byId("no-curves").hidden = found.length > 0
  },

  recording(found) {
    const record = byId("record")
    record.dataset.on = found.on
    put(record.querySelector("span"), found.on ? "Stop recording" : "Record")
    record.disabled = !found.can
    put(byId("recording"), found.text)
    byId("recording").dataset.level = found.level
  },

  events(found) {
    byId("events").replaceChildren(...found.map(event =>
      make("li", {"data-level": {error: "bad", missed: "bad", gap: "wait"}[event.kind] ?? "plain"},
        make("time", {}, clock(new Date(event.time_ms))), event.text)))
  },

  link: found => rows("link", found),
  hardware: found => rows("hardware", found),
  own(found) {
    byId("own-part").hidden = !found.length
    rows("own", found)
  },
}

// The server draws these images itself, so they contain no scripts.
const parse = text => document.importNode(new DOMParser().parseFromString(text, "image/svg+xml").documentElement, true)

function rows(id, found) {
  const list = byId(id)
  if (list.children.length !== 2 * found.length) list.replaceChildren(...found.flatMap(() => [make("dt"), make("dd")]))
  found.forEach(([label, value, level], number) => {
    put(list.children[2 * number], label)
    put(list.children[2 * number + 1], value)
    list.children[2 * number + 1].dataset.level = level ?? "plain"
  })
}

const upper = text => text[0].toUpperCase() + text.slice(1)

const guard = (whose, found) => found.length ? `${whose}: ` + found.map(([words, count]) => `${words} (${count})`).join(", ") : ""

// --- diagrams over time ---

const MOVES = "the sensor moves", CHECKED = 1000, NORMAL_95 = 1.96, FIGURES = [
  // for each diagram: name, title, where the axis has to be estimated, and curves, each with kind, label and
  // columns
  ["noise", "samples less the offset, and bias", "host device both", [["sample", "sample", "y", "y_low", "y_high"], ["state", "bias less the offset, 95 %", "state", "±"]]],
  ["alpha", "order α", "host device both", [["fit", "fit, 95 %", "alpha_mid", "alpha_low", "alpha_high"], ["estimate", "FLTEA, 95 %", "alpha", "±"], ["ink", "device", "device_alpha"]]],
  ["f", "parameter f [s^−α]", "host device both", [["fit", "fit, 95 %", "f_mid", "f_low", "f_high"], ["estimate", "FLTEA, 95 %", "f", "±"], ["ink", "device", "device_f"]]],
  ["apart", "α of the device minus α of the host", "both", [["sample", "difference and its extremes", "apart", "apart_low", "apart_high"]]],
  ["lag1", "innovations: correlation of neighbours; grey: white", "host both", [["estimate", "last 1,000", "lag1"]], [-2 / Math.sqrt(CHECKED), 2 / Math.sqrt(CHECKED)]],
  ["nis", "innovations: NIS; grey: right", "host both", [["estimate", "last 1,000", "nis"]], [1 - 2 * Math.sqrt(2 / CHECKED), 1 + 2 * Math.sqrt(2 / CHECKED)]],
  ["temperature", "temperature of the sensor [°C]", "host device both", [["state", "", "temperature"]]],
]

function figures({estimator, unit}) {
  const place = byId("courses"), of = `${estimator} ${unit} ${choice.axis}`
  if (place.dataset.of === of) return
  place.dataset.of = of
  place.replaceChildren(...FIGURES.filter(([, , estimators]) => estimators.split(" ").includes(estimator)).map(([name, title, , lines]) => {
    const words = name === "noise" ? `${title} [${unit}]` : title
    const shown = lines.filter(([kind]) => kind !== "ink" || estimator === "both")
    const marked = name === "noise" ? [["mark", "step of the bias"], ["motion", MOVES]] : []
    return make("figure", {"data-name": name}, make("figcaption", {}, words, ...keys([...shown, ...marked])),
      make("svg:svg", {role: "img", "aria-label": `${words}, ${choice.axis}, over time`}))
  }))
}

const keys = found => found.flatMap(([kind, label]) => label ? [" ", make("span", {}, make("i", {class: `key ${kind}`}), label)] : [])

// Returns a table with the new rows appended.
function longer(before, {rows, fresh, cursor, most}) {
  const kept = fresh ? {} : before.columns, had = (kept.time ?? []).length
  for (const name of new Set([...Object.keys(kept), ...Object.keys(rows)])) {
    const old = kept[name] ?? new Array(had).fill(null), more = rows[name] ?? new Array(rows.time.length).fill(null)
    kept[name] = [...old, ...more].slice(-most)
  }
  return {cursor, columns: kept}
}

// Returns one end of the 95 % intervals for a column that has a column of standard deviations.
const end = (columns, name, sign) => columns[name].map((v, i) =>
  v === null || columns[`${name}_std`]?.[i] == null ? null : v + sign * NORMAL_95 * columns[`${name}_std`][i])

// Draws the small diagrams of the last two minutes for all axes.
function drawings(found) {
  drawn = longer(drawn, found)
  const kept = drawn.columns, x = kept.time, from = found.end_ms - found.length_ms
  for (const card of document.querySelectorAll(".axis")) {
    const y = `${card.dataset.axis} y`, bias = `${card.dataset.axis} state`, lines = []
    if (kept[y]) lines.push({x, y: kept[y], low: kept[`${y}_low`], high: kept[`${y}_high`], kind: "sample"})
    if (kept[bias]) lines.push({x, y: kept[bias], low: end(kept, bias, -1), high: end(kept, bias, 1), kind: "state"})
    draw(card.querySelector(".rate svg"), {lines, from, to: found.end_ms, height: isWide.matches ? 150 : 110})
  }
}

function course(found) {
  table = longer(table, found)
  const kept = table.columns, {end_ms, length_ms} = found
  for (const figure of byId("courses").children) {
    const [, , , wanted, band] = FIGURES.find(([name]) => name === figure.dataset.name)
    const lines = wanted.filter(([, , y]) => kept[y]).map(([kind, , y, low, high]) => {
      return {x: kept.time, y: kept[y], kind, loose: kind === "fit",
        ...low === "±" ? {low: end(kept, y, -1), high: end(kept, y, 1)} : low ? {low: kept[low], high: kept[high]} : {}}
    })
    figure.hidden = !lines.some(one => one.y.some(v => v !== null))
    draw(figure.querySelector("svg"), {lines, band, always: band ?? (figure.dataset.name === "apart" ? [0] : []),
      ...figure.dataset.name === "noise" ? {marks: marks.steps, spans: marks.motion} : {}, from: end_ms - length_ms, to: end_ms})
  }
}

// --- buttons ---

for (const one of byId("windows").children) one.addEventListener("click", () => choose({window: Number(one.dataset.window)}))
for (const one of document.querySelectorAll("details[data-parts]")) one.addEventListener("toggle", refresh)
byId("course").open = choice.course
byId("course").addEventListener("toggle", () => choose({course: byId("course").open}))
addEventListener("hashchange", () => { Object.assign(choice, fromHash()); refresh() })

byId("record").addEventListener("click", async () => {
  const record = byId("record"), want = record.dataset.on === "true" ? "off" : "on"
  record.disabled = true
  let problem = ""
  try { await ask("recording", {device: choice.device, want}, "POST") }
  catch (error) { problem = error instanceof TypeError ? "The daemon does not answer." : error.message }
  put(byId("problem"), problem)
  byId("problem").hidden = !problem
  delete has.recording
  refresh()
})
