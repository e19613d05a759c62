// Functions that the pages of a sensor and of a fleet share. Whatever comes from a device is inserted as
// text, never as HTML.
export const byId = id => document.getElementById(id)

export function make(tag, attributes = {}, ...children) {
  const made = tag.startsWith("svg:") ? document.createElementNS("http://www.w3.org/2000/svg", tag.slice(4))
    : document.createElement(tag)
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value)
  made.append(...children)
  return made
}

export function button(label, onClick, attributes = {}) {
  const made = make("button", {type: "button", ...attributes}, label)
  made.addEventListener("click", onClick)
  return made
}

// Changes the text only if it differs, so that a selection is kept and screen readers do not repeat the text.
export function put(place, text) { if (place.textContent !== text) place.textContent = text }

export async function ask(path, parameters = {}, method = "GET") {
  const answer = await fetch(`${path}?${new URLSearchParams(parameters)}`,
    {method, cache: "no-store", headers: {"X-Fltea": "1"}, signal: AbortSignal.timeout(method === "GET" ? 5000 : 20000)})
  if (!answer.ok) {
    const wait = 1000 * Number(answer.headers.get("Retry-After") ?? 0)
    throw Object.assign(new Error((await answer.text()).trim()), {wait})
  }
  return answer
}

// Asks the server again and again while the page is visible. If no answer comes, the page turns grey and
// shows the time of the last answer.
export function follow(turn, everyMs) {
  let timer, busy = false, again = false, last = null
  async function go() {
    again = busy
    if (busy || document.hidden) return
    clearTimeout(timer)
    let wait = everyMs
    busy = true
    try {
      await turn()
      last = new Date()
      show("")
    } catch (error) {
      wait = Math.max(wait, error.wait ?? 0)
      const silent = error instanceof TypeError || error.name === "TimeoutError"
      const since = last ? ` All below is as of ${clock(last)}.` : ""
      show((silent ? "fltea does not answer; this page goes on by itself when it does." : error.message) + since)
    }
    busy = false
    timer = setTimeout(go, again ? 0 : wait)
  }
  function show(text) {
    put(byId("gone"), text)
    byId("gone").hidden = !text
    document.documentElement.dataset.connection = text ? "lost" : "up"
  }
  document.addEventListener("visibilitychange", go)
  go()
  return go
}

export const clock = date => date.toLocaleTimeString([], {hour12: false})

export const short = value => value === null || value === undefined ? "" : String(Number(value.toPrecision(4))).replace("-", "\u2212")

// --- A diagram over time: curves with areas around them; x is the time in ms. Five diagrams take 1.5 % of a
// processor core. A library such as uPlot would have to be downloaded at set-up, fixed to a version, and
// packaged. ---

const LEFT = 58, RIGHT = 8, TOP = 6, BOTTOM = 22, HEIGHT = 170
const STEPS_S = [5, 10, 30, 60, 120, 300, 600, 1200, 3600, 7200, 14400, 21600, 43200, 86400, 172800, 604800, 2592000]

// lines: curves [{x, y, low, high, kind, loose}], where low and high are the edges of the area around the
// curve; if loose is set, the diagram may cut this area off. marks: vertical marks [time, label]. spans:
// periods [begin, end], where end is null if the period still lasts.
export function draw(svg, {lines, from, to, log = false, always = [], band = null, marks = [], spans = [], height = HEIGHT}) {
  const width = svg.clientWidth || 600
  const good = v => v !== null && v !== undefined && (!log || v > 0)
  const level = log ? Math.log10 : v => v
  const of = loose => lines.filter(l => Boolean(l.loose) === loose).flatMap(l => [l.low, l.high, ...loose ? [] : [l.y]])
    .flatMap(column => (column ?? []).filter(good).map(level))
  const tight = [...of(false), ...lines.flatMap(l => l.y.filter(good).map(level)), ...always.map(level)]
  if (!tight.length) { svg.replaceChildren(); return }
  let [low, high] = ends(tight)
  const beyond = high - low || Math.abs(high) || 1
  ;[low, high] = ends([low, high, ...of(true).map(v => Math.min(Math.max(v, low - beyond), high + beyond))])
  const room = (high - low || Math.abs(high) * 1e-3 || 1e-6) * 0.08
  low -= room
  high += room
  const x = t => LEFT + (t - from) / (to - from || 1) * (width - LEFT - RIGHT)
  const y = v => TOP + Math.min(Math.max((high - level(v)) / (high - low), 0), 1) * (height - TOP - BOTTOM)
  const parts = []
  for (const tick of ticks(low, high)) {
    const value = log ? 10 ** tick : tick, at = y(value)
    parts.push(make("svg:line", {class: "grid", x1: LEFT, x2: width - RIGHT, y1: at, y2: at}),
      make("svg:text", {x: LEFT - 5, y: at + 4, "text-anchor": "end"}, short(value)))
  }
  for (const [t, label] of times(from, to, width))
    parts.push(make("svg:text", {x: x(t), y: height - 5, "text-anchor": "middle"}, label))
  if (band) parts.push(make("svg:rect", {class: "area band", x: LEFT, width: width - LEFT - RIGHT, y: y(band[1]), height: y(band[0]) - y(band[1])}))
  for (const [begin, end] of spans.filter(([begin, end]) => begin < to && (end ?? to) > from)) {
    const left = x(Math.max(begin, from)), right = x(Math.min(end ?? to, to))
    parts.push(make("svg:rect", {class: "motion", x: left, width: Math.max(right - left, 1), y: TOP, height: height - TOP - BOTTOM}))
  }
  for (const one of lines) {
    const shown = one.x.map((t, i) => [t, i]).filter(([t]) => t >= from && t <= to)
    for (const run of runs(shown, i => good(one.low?.[i]) && good(one.high?.[i])))
      parts.push(make("svg:polygon", {class: `area ${one.kind}`, points: [
        ...run.map(([t, i]) => `${x(t).toFixed(1)},${y(one.high[i]).toFixed(1)}`),
        ...run.reverse().map(([t, i]) => `${x(t).toFixed(1)},${y(one.low[i]).toFixed(1)}`)].join(" ")}))
    for (const run of runs(shown, i => good(one.y[i])))
      parts.push(make("svg:polyline", {class: `line ${one.kind}`,
        points: run.map(([t, i]) => `${x(t).toFixed(1)},${y(one.y[i]).toFixed(1)}`).join(" ")}))
  }
  const taken = [-Infinity, -Infinity, -Infinity]  // right end of the last label in each of three rows
  for (const [time, label] of marks.filter(([time]) => time >= from && time <= to)) {
    const at = x(time), wide = 8 * label.length + 6, left = at + wide < width ? at : at - wide
    parts.push(make("svg:line", {class: "mark", x1: at, x2: at, y1: TOP, y2: height - BOTTOM}))
    const row = taken.findIndex(end => end <= left)
    if (row < 0) continue  // the label would cover another one
    parts.push(make("svg:text", {class: "marked", x: left + 3, y: TOP + 11 + 13 * row}, label))
    taken[row] = left + wide
  }
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`)
  svg.setAttribute("height", height)
  svg.replaceChildren(...parts)
}

const ends = values => values.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity])

// Returns the parts of a curve between missing values, so that no curve is drawn across a gap.
function runs(points, isGood) {
  const found = [[]]
  for (const point of points)
    if (isGood(point[1])) found.at(-1).push(point)
    else if (found.at(-1).length) found.push([])
  return found.filter(run => run.length)
}

function ticks(low, high) {
  const rough = (high - low) / 4, power = 10 ** Math.floor(Math.log10(rough))
  const step = [1, 2, 5, 10].find(f => f * power >= rough) * power
  const found = []
  for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(k * step)
  return found
}

function times(from, to, width) {
  const step = 1000 * (STEPS_S.find(s => (to - from) / s / 1000 <= Math.max(2, width / 110)) ?? STEPS_S.at(-1))
  const zone = new Date(from).getTimezoneOffset() * 60000
  const found = []
  for (let t = Math.ceil((from - zone) / step) * step + zone; t <= to; t += step) {
    const date = new Date(t), digits = {hour: "2-digit", minute: "2-digit", ...step < 60000 && {second: "2-digit"}}
    found.push([t, step < 86400000 ? date.toLocaleTimeString([], {hour12: false, ...digits}) : date.toLocaleDateString()])
  }
  return found
}

// --- light, dark, or as the system has it ---

const THEMES = ["system", "light", "dark"]
let theme = "system"
try { theme = localStorage.getItem("fltea-theme") ?? theme } catch { /* a private window */ }

function applyTheme() {
  document.documentElement.dataset.theme = theme
  put(byId("theme"), `theme: ${theme}`)
}
byId("theme").addEventListener("click", () => {
  theme = THEMES[(THEMES.indexOf(theme) + 1) % THEMES.length]
  try { localStorage.setItem("fltea-theme", theme) } catch { /* the same */ }
  applyTheme()
})
applyTheme()
