// The page's words and numbers, its choices, and its theme. The figures are bokeh's.
window.fltea = (() => {
  "use strict"
  const byId = id => document.getElementById(id)
  const RETRY_MS = 2000
  const OF_DEVICE = "of the device"  // what plot_style.py calls it
  let facts, control, plots
  let choice = {device: "", axis: "", window: null}
  let shown = null

  function start(factsSource, controlSource, allPlots) {
    facts = factsSource
    control = controlSource
    plots = allPlots
    choice = {...choice, ...fromHash()}
    window.addEventListener("hashchange", () => { Object.assign(choice, fromHash()); send() })
    facts.document.on_event("connection_lost", lost)
    applyTheme()
    show(facts)
    send()
  }

  function show(source) {
    const text = source.data.json[0]
    if (!text || !control) return
    shown = JSON.parse(text)
    render(shown)
    send()
  }

  // What the reader has chosen, and that the update has arrived: without this there is no next one.
  function send() {
    control.data = {
      device: [choice.device], axis: [choice.axis], window: [choice.window], ack: [shown ? shown.tick : 0],
    }
  }

  function choose(change) {
    Object.assign(choice, change)
    history.replaceState(null, "", "#" + new URLSearchParams(
      Object.entries(choice).filter(([, value]) => value !== "" && value !== null)))
    send()
  }

  function fromHash() {
    const found = new URLSearchParams(location.hash.slice(1))
    const window = found.get("window")
    return {
      device: found.get("device") ?? "", axis: found.get("axis") ?? "",
      window: window === null ? null : Number(window),
    }
  }

  // --- words and numbers; all of them as text, since some come from the device ---

  function element(tag, attributes = {}, ...children) {
    const made = document.createElement(tag)
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value)
    made.append(...children)
    return made
  }

  function button(label, onClick) {
    const made = element("button", {type: "button"}, label)
    made.addEventListener("click", onClick)
    return made
  }

  function render(f) {
    const root = document.documentElement
    root.dataset.seq = f.seq ?? ""
    root.dataset.epoch = f.epoch ?? ""
    root.dataset.tick = f.tick
    root.dataset.estimator = f.estimator
    document.title = `fltea ${f.device}`
    byId("status").textContent = f.status.text
    byId("status").dataset.level = f.status.level
    byId("settings").textContent = [
      f.device, f.settings, f.seq === null ? "" : `sample ${f.seq.toLocaleString()}`,
      f.time_ms === null ? "" : new Date(f.time_ms).toLocaleTimeString(),
    ].filter(Boolean).join(" · ")
    devices(f)
    windows(f)
    axes(f)
    for (const place of document.querySelectorAll(".axis")) place.textContent = f.axis
    byId("temperature").hidden = !f.hardware.some(([label]) => label === "temperature")
    rows("link", f.link)
    rows("hardware", f.hardware)
    byId("own-part").hidden = !f.own.length
    rows("own", f.own)
    events(f.events)
    window.fltea.actions.show(f)
    byId("fitted").textContent = f.fit
    for (const name of ["spectrum", "allan", "heading"]) {
      for (const part of document.querySelectorAll(`#${name} .drawn`)) part.hidden = !f.curves[name]
      for (const part of document.querySelectorAll(`#${name} .not-drawn`)) part.hidden = f.curves[name]
    }
    rows("coefficients", f.curves.coefficients)
    rows("headings", f.curves.headings)
    const label = f.unit ? `${f.axis} [${f.unit}]` : ""
    const noise = plots.find(plot => plot.name === "noise").left[0]
    if (noise.axis_label !== label) noise.setv({axis_label: label}, {sync: false})
  }

  function devices(f) {
    const place = byId("devices")
    place.hidden = f.devices.length < 2
    if (!place.children.length)
      place.append(...f.devices.map(device => button(device.name, () => choose({device: device.name, axis: ""}))))
    f.devices.forEach((device, number) => {
      const one = place.children[number]
      one.setAttribute("aria-pressed", device.name === f.device)
      one.dataset.status = device.level
      one.title = device.text
    })
  }

  function windows(f) {
    const place = byId("windows")
    if (!place.children.length)
      place.append(...f.windows.map((label, number) => button(label, () => choose({window: number}))))
    ;[...place.children].forEach((b, number) => b.setAttribute("aria-pressed", number === f.window))
  }

  function axes(f) {
    const place = byId("axes")
    const names = f.axes.map(axis => axis.name).join()
    if (place.dataset.names !== names) {
      place.dataset.names = names
      place.replaceChildren(...f.axes.map(card))
    }
    f.axes.forEach((axis, number) => fill(place.children[number], axis, axis.name === f.axis))
    const chosen = f.axes.find(axis => axis.name === f.axis)
    const compared = chosen ? chosen.compared : null
    for (const apart of document.querySelectorAll("figure .apart")) compare(apart, compared, apart.dataset.of)
    for (const part of document.querySelectorAll("#apart .drawn")) part.hidden = !(compared && compared.drawn)
  }

  // How far the device's own estimate is from the host's, or why nobody can say.
  function compare(place, compared, name) {
    place.textContent = !compared ? "" : compared.why_not || `device − host: ${compared[`${name}_apart`]} of what is shown`
    place.dataset.compared = compared && compared.why_not ? "no" : "yes"
  }

  function card(axis) {
    const made = element("section", {class: "card", "data-axis": axis.name, "aria-label": axis.name})
    made.innerHTML = `<h2><button type="button" class="pick"></button></h2>
      <p class="head"></p><p class="bias"></p>
      <dl class="order"><div><dt>α</dt><dd class="alpha"></dd></div>
        <div><dt>f</dt><dd class="f"></dd></div></dl>
      <p class="condition"></p><p class="text"></p><p class="until"></p><p class="left-out"></p>
      <dl class="of-board"><div><dt>α, the board's fit</dt><dd class="board-alpha"></dd></div></dl>
      <p class="board-text"></p>
      <p class="why-not"></p><p class="guard"></p><p class="guard guard-of-device"></p>
      <details><summary>FLTEA, the running filter</summary><dl class="rows"></dl></details>`
    made.querySelector(".pick").textContent = axis.name
    made.addEventListener("click", event => { if (!event.target.closest("details")) choose({axis: axis.name}) })
    return made
  }

  function fill(made, axis, pressed) {
    const set = (selector, text) => {
      const place = made.querySelector(selector)
      if (place.textContent !== text) place.textContent = text  // else what is selected would be lost
    }
    const found = axis.answer, compared = axis.compared
    made.querySelector(".pick").setAttribute("aria-pressed", pressed)
    made.classList.toggle("picked", pressed)
    made.dataset.verdict = found.kind
    made.dataset.alpha = axis.running.alpha ?? ""
    made.dataset.f = axis.running.f ?? ""
    for (const text of ["head", "text", "condition", "until", "left_out"]) set("." + text.replace("_", "-"), found[text])
    set(".bias", axis.bias)
    made.querySelector(".order").hidden = !found.kind
    parameter(made.querySelector("dd.alpha"), found.alpha, [])
    parameter(made.querySelector("dd.f"), found.f, [" s", element("sup", {}, "−α")])
    const board = axis.of_board
    made.querySelector(".of-board").hidden = !board
    if (board) parameter(made.querySelector("dd.board-alpha"), board.alpha, [])
    set(".board-text", board ? board.text : "")
    set(".guard", guard("FLTEA's guard", axis.guard))
    made.dataset.apart = compared ? compared.apart ?? "" : ""
    set(".why-not", compared ? compared.why_not : "")
    set(".guard-of-device", compared ? guard("the device's guard", compared.guard) : "")
    fillRows(made.querySelector("dl.rows"), compared ? [...axis.rows, ...compared.rows] : axis.rows)
  }

  // A figure is large only where the data support it.
  function parameter(place, found, unit) {
    const text = JSON.stringify(found)
    if (place.dataset.text === text) return
    place.dataset.text = text
    if (!found) { place.replaceChildren(element("span", {class: "undefined"}, "undefined")); return }
    const [value, interval, large] = found
    place.replaceChildren(element("span", {class: large ? "big" : "small"}, value), " ",
      element("span", {class: "interval"}, interval, ...unit))
  }

  function guard(whose, found) {
    return found.length ? `${whose}: ` + found.map(([words, count]) => `${words} (${count})`).join(", ") : ""
  }

  function rows(id, found) { fillRows(byId(id), found) }

  function fillRows(list, found) {
    if (list.children.length !== 2 * found.length)
      list.replaceChildren(...found.flatMap(() => [element("dt"), element("dd")]))
    found.forEach(([label, value, level], number) => {
      list.children[2 * number].textContent = label
      list.children[2 * number + 1].textContent = value
      list.children[2 * number + 1].dataset.level = level ?? "plain"
    })
  }

  function events(found) {
    const text = JSON.stringify(found)
    const list = byId("events")
    if (list.dataset.text === text) return
    list.dataset.text = text
    list.replaceChildren(...found.map(event => element("li", {"data-kind": event.kind},
      element("time", {}, new Date(event.time_ms).toLocaleTimeString()), event.text)))
  }

  // --- theme: light, dark, or the system's ---

  const darkSystem = matchMedia("(prefers-color-scheme: dark)")
  const THEMES = ["system", "light", "dark"]
  const stored = () => { try { return localStorage.getItem("fltea-theme") ?? "system" } catch { return "system" } }
  let theme = stored()

  function nextTheme() {
    theme = THEMES[(THEMES.indexOf(theme) + 1) % THEMES.length]
    try { localStorage.setItem("fltea-theme", theme) } catch { /* private window */ }
    applyTheme()
  }

  function applyTheme() {
    const dark = theme === "dark" || (theme === "system" && darkSystem.matches)
    document.documentElement.dataset.theme = dark ? "dark" : "light"
    const button = byId("theme")
    if (button) button.textContent = `theme: ${theme}`
    if (!plots) return
    const style = getComputedStyle(document.documentElement)
    const colour = name => style.getPropertyValue(name).trim()
    const axis = {
      axis_line_color: colour("--rule"), major_tick_line_color: colour("--rule"), minor_tick_line_color: null,
      major_label_text_color: colour("--soft"), axis_label_text_color: colour("--ink"),
      axis_label_text_font_style: "normal",
    }
    for (const plot of plots) {
      for (const one of [...plot.below, ...plot.left]) one.setv(axis, {sync: false})
      for (const one of plot.center)
        if (one.type === "Grid") one.setv({grid_line_color: colour("--grid")}, {sync: false})
      for (const one of plot.renderers)
        if (one.name === OF_DEVICE) one.glyph.setv({line_color: colour("--ink")}, {sync: false})
    }
  }
  applyTheme()
  darkSystem.addEventListener("change", applyTheme)
  document.addEventListener("DOMContentLoaded", () => {
    applyTheme()
    byId("theme").addEventListener("click", nextTheme)
  })

  // --- the daemon has ended ---

  function lost() {
    byId("gone").hidden = false
    document.documentElement.dataset.connection = "lost"
    setTimeout(retry, RETRY_MS)
  }

  async function retry() {
    try {
      const answer = await fetch("static/js/bokeh.min.js", {method: "HEAD", cache: "no-store"})
      if (answer.ok) { location.reload(); return }
    } catch { /* not there yet */ }
    setTimeout(retry, RETRY_MS)
  }

  return {start, show}
})()
