// Browsers start no workers for pages that are opened as files. There the search runs in a hidden frame instead.
if (location.protocol === "file:") {
  window.IFrameWorker = window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.waiting = [];
      const frame = document.createElement("iframe");
      frame.hidden = true;
      const started = () => {
        this.inside = frame.contentWindow;
        // what the script posts arrives here, and the script hears what is posted to this object
        this.inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
        this.inside.importScripts = (...urls) => urls.reduce((before, next) => before.then(() => this.load(next)), Promise.resolve());
        this.load(url).then(() => this.waiting.splice(0).forEach((data) => this.postMessage(data)));
      };
      frame.addEventListener("load", started, { once: true });
      frame.srcdoc = "<!doctype html><html><body></body></html>";
      document.body.append(frame);
    }
    load(url) {
      return new Promise((done, failed) => {
        const script = this.inside.document.createElement("script");
        script.src = new URL(url, document.baseURI);
        script.onload = () => { this.ready = true; done(); };
        script.onerror = failed;
        this.inside.document.body.append(script);
      });
    }
    postMessage(data) {
      if (this.ready) this.inside.dispatchEvent(new MessageEvent("message", { data }));
      else this.waiting.push(data);
    }
    terminate() {}
  };
}
