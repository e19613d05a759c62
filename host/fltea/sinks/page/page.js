// The page's words and numbers, its choices, and its theme. The figures are bokeh's.
window.fltea = (() => {
  "use strict"
  const byId = id => document.getElementById(id)
  const RETRY_MS = 2000
  const OF_DEVICE = "of the device"  // what figures.py calls it
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
    const label = f.unit ? `${f.axis} [${f.unit}]` : ""
    if (plots[0].left[0].axis_label !== label) plots[0].left[0].setv({axis_label: label}, {sync: false})
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
    for (const whiteness of document.querySelectorAll("figure .whiteness")) {
      whiteness.textContent = chosen ? chosen.whiteness_text : ""
      whiteness.dataset.whiteness = chosen ? chosen.whiteness : "unknown"
    }
    for (const verdict of document.querySelectorAll("figure .verdict")) {
      verdict.textContent = chosen ? chosen.verdict_short : ""
      verdict.dataset.side = chosen ? chosen.side : "unknown"
    }
    const beside = chosen ? chosen.beside : null
    for (const apart of document.querySelectorAll("figure .apart")) compare(apart, beside, apart.dataset.of)
    for (const part of document.querySelectorAll("#apart .drawn")) part.hidden = !(beside && beside.drawn)
  }

  // How far the device's own estimate is from the host's, or why nobody can say.
  function compare(place, beside, name) {
    place.textContent = !beside ? "" : beside.why_not || `device − host: ${beside[`${name}_apart`]} of what is shown`
    place.dataset.compared = beside && beside.why_not ? "no" : "yes"
  }

  function card(axis) {
    const made = element("div", {class: "card", role: "button", tabindex: "0", "data-axis": axis.name})
    made.innerHTML = `<h2></h2>
      <div class="pair"><b>α</b><span class="big alpha"></span><span class="beside alpha-white"></span>
        <span class="beside alpha-device"></span></div>
      <div class="pair"><b>f</b><span class="big"><span class="f"></span> <small>s<sup>-α</sup></small></span><span class="beside f-white"></span>
        <span class="beside f-device"></span></div>
      <p class="whiteness"></p><p class="verdict"></p><p class="why-not"></p><p class="guard"></p><p class="guard guard-of-device"></p><details><summary>more</summary><dl></dl></details>`
    made.querySelector("h2").textContent = axis.name
    const pick = () => choose({axis: axis.name})
    made.addEventListener("click", event => { if (!event.target.closest("details")) pick() })
    made.addEventListener("keydown", event => {
      if (event.target === made && (event.key === "Enter" || event.key === " ")) { event.preventDefault(); pick() }
    })
    return made
  }

  function fill(made, axis, pressed) {
    const set = (selector, text) => { made.querySelector(selector).textContent = text }
    made.setAttribute("aria-pressed", pressed)
    made.dataset.alpha = axis.alpha ?? ""
    made.dataset.f = axis.f ?? ""
    set(".alpha", axis.alpha_text)
    set(".f", axis.f_text)
    set(".alpha-white", `white noise: ${axis.alpha_white}`)
    set(".f-white", `white noise: ${axis.f_white}`)
    set(".whiteness", axis.whiteness_text)
    made.querySelector(".whiteness").dataset.whiteness = axis.whiteness
    set(".verdict", axis.verdict)
    made.querySelector(".verdict").dataset.side = axis.side
    set(".guard", guard("guard", axis.guard))
    const beside = axis.beside
    made.dataset.apart = beside ? beside.apart ?? "" : ""
    set(".alpha-device", ofDevice(beside, "alpha"))
    set(".f-device", ofDevice(beside, "f"))
    set(".why-not", beside ? beside.why_not : "")
    set(".guard-of-device", beside ? guard("the device's guard", beside.guard) : "")
    fillRows(made.querySelector("dl"), beside ? [...axis.rows, ...beside.rows] : axis.rows)
  }

  function ofDevice(beside, name) {
    if (!beside) return ""
    const apart = beside.why_not ? "" : `; minus host: ${beside[`${name}_apart`]}`
    return `device: ${beside[`${name}_text`]}${apart}`
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
