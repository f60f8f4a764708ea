// Pages that are opened from the disk may start no worker, which the search runs in: there a frame of the page stands for it.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      const frame = document.createElement("iframe")
      frame.hidden = true
      document.body.appendChild(frame)
      const inside = frame.contentWindow
      inside.postMessage = data => this.dispatchEvent(new MessageEvent("message", {data}))
      inside.importScripts = (...urls) => urls.reduce((before, each) => before.then(() => load(frame, each)), Promise.resolve())
      this.send = load(frame, url).then(() => data => inside.dispatchEvent(new inside.MessageEvent("message", {data})))
    }

    postMessage(data) {
      this.send.then(send => send(data))
    }
  }

  const load = (frame, url) => new Promise((loaded, failed) => {
    const script = frame.contentDocument.createElement("script")
    script.src = url
    script.onload = loaded
    script.onerror = failed
    frame.contentDocument.head.appendChild(script)
  })
}
