// Search on pages that are opened from the file system. Browsers refuse web workers there, so the
// theme's search worker runs in a hidden frame instead. The theme looks for the name IFrameWorker.
if (location.protocol === "file:") {
  window.IFrameWorker = window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.append(frame);
      this.worker = frame.contentWindow;
      window.addEventListener("message", ({ source, data }) => {
        if (source === this.worker) this.dispatchEvent(new MessageEvent("message", { data }));
      });
      const script = document.createElement("script");
      script.src = url;
      this.worker.document.open();
      this.worker.document.write(
        `<body><script>postMessage = (data) => parent.postMessage(data, "*")</script>${script.outerHTML}`
      );
      this.worker.document.close();
      // After open(), which removes listeners.
      this.loaded = new Promise((resolve) => this.worker.addEventListener("load", resolve));
    }

    async postMessage(data) {
      await this.loaded;
      this.worker.dispatchEvent(new MessageEvent("message", { data }));
    }
  };
}
