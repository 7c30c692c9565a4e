// Browsers start no worker from a file: the search's runs in a frame instead.
if (location.protocol === "file:")
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.body.appendChild(Object.assign(document.createElement("iframe"), { hidden: true }));
      const inside = frame.contentWindow, script = inside.document.createElement("script");
      inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      this.started = new Promise((ready) => (script.onload = ready));
      this.postMessage = (data) => this.started.then(() => inside.dispatchEvent(new MessageEvent("message", { data })));
      inside.document.head.append(Object.assign(script, { src: url }));
    }
  };
