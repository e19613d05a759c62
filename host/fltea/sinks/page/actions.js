// The page's buttons: record, and take a report or imu.yaml home. Each request brings the page's token.
window.fltea.actions = (() => {
  "use strict"
  const byId = id => document.getElementById(id)
  let device = "", on = false, busy = false, shown = ""

  async function ask(path, method) {
    const token = document.querySelector("meta[name=fltea-token]").content
    const answer = await fetch(path, {method, headers: {"X-Fltea-Token": token}, cache: "no-store"})
    if (!answer.ok) throw new Error(await answer.text())
    return answer
  }

  // One at a time; what goes wrong is shown in words.
  async function act(what) {
    if (busy) return
    busy = true
    say("")
    try { await what() }
    catch (error) { say(error instanceof TypeError ? "The daemon does not answer." : error.message) }
    finally { busy = false }
  }

  function say(text) {
    shown = text
    byId("problem").textContent = text
    byId("problem").hidden = !text
  }

  const of = () => "?device=" + encodeURIComponent(device)
  const record = () => act(() => ask(`recording${of()}&want=${on ? "off" : "on"}`, "POST"))

  const download = path => act(async () => {
    const answer = await ask(path + of(), "GET")
    const name = /filename="([^"]+)"/.exec(answer.headers.get("Content-Disposition") ?? "")
    const link = document.createElement("a")
    link.href = URL.createObjectURL(await answer.blob())
    link.download = name ? name[1] : path
    link.click()
    setTimeout(() => URL.revokeObjectURL(link.href), 60000)
  })

  function show(f) {
    if (device !== f.device && shown) say("")
    device = f.device
    on = f.recording.on
    const button = byId("record")
    button.dataset.on = on
    button.querySelector("span").textContent = on ? "Stop recording" : "Record"
    button.disabled = !f.recording.can
    for (const id of ["report", "yaml"]) byId(id).disabled = !f.fit
    const place = byId("recording")
    if (place.textContent !== f.recording.text) place.textContent = f.recording.text
    place.dataset.level = f.recording.level
  }

  document.addEventListener("DOMContentLoaded", () => {
    byId("record").addEventListener("click", record)
    byId("report").addEventListener("click", () => download("report.html"))
    byId("yaml").addEventListener("click", () => download("imu.yaml"))
  })

  return {show}
})()
