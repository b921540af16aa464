// The page in a cell of a notebook: its messages are those of the kernel.

const CHUNK = 1 << 20; // bytes of a file that are sent at once
const HERE = 20_000; // milliseconds after which the kernel is told again that somebody looks
const PATIENCE = 4000; // milliseconds that it may take to answer that

/** A transport, as `mount` takes, for one view of a widget. */
function overKernel(model) {
  const view = randomKey();
  const say = (content, buffers) => model.send({ view, ...content }, undefined, buffers);
  let [heard, connected, patience, taken] = [null, null, null, null];

  const connect = (yes, line = "") => {
    if (yes === connected) return;
    connected = yes;
    heard.state({ connected: yes, line });
  };
  const here = () => {
    say({ here: true });
    clearTimeout(patience);
    patience = setTimeout(() => connect(false, "the kernel does not answer: it runs a cell, or has ended"), PATIENCE);
  };
  const receive = (content, buffers) => {
    if (content.view !== view) return;
    clearTimeout(patience);
    connect(true);
    if (content.taken) taken?.(content.taken);
    else if (content.text !== undefined) heard.message(JSON.parse(content.text));
    else for (const { buffer, byteOffset, byteLength } of buffers ?? []) heard.binary(buffer.slice(byteOffset, byteOffset + byteLength));
  };
  model.on("msg:custom", receive);
  const beat = setInterval(here, HERE);

  /** Sends a file in parts, each when the one before has been written. */
  const upload = async (file, kind, onPart = () => {}) => {
    for (let from = 0; ; from += CHUNK) {
      const [end, answered] = [Math.min(from + CHUNK, file.size), new Promise((resolve) => { taken = resolve; })];
      say({ upload: file.name, kind, isFirst: from === 0, isLast: end === file.size }, [await file.slice(from, end).arrayBuffer()]);
      const { path, line } = await answered;
      if (line) throw new Error(line);
      onPart(file.size ? end / file.size : 1);
      if (path) return path;
    }
  };
  let last = Promise.resolve(); // one file after the other

  return {
    send: (message) => say({ said: JSON.stringify(message) }),
    listen: (callbacks) => { heard = callbacks; },
    upload: (file, kind, onPart) => {
      const whole = last.then(() => upload(file, kind, onPart));
      last = whole.catch(() => {});
      return whole;
    },
    open: here,
    close: () => {
      say({ gone: true });
      clearInterval(beat);
      clearTimeout(patience);
      model.off("msg:custom", receive);
    },
  };
}

export default {
  render({ model, el }) {
    const element = document.createElement("div");
    const fit = () => { element.style.height = model.get("height"); };
    fit();
    model.on("change:height", fit);
    // Keys that mean something here mean nothing to the notebook.
    element.dataset.lmSuppressShortcuts = "true";
    element.addEventListener("keydown", (event) => event.stopPropagation());
    el.append(element);
    const transport = overKernel(model);
    const page = mount(element, transport);
    transport.open();
    return () => {
      page.close();
      transport.close();
      model.off("change:height", fit);
    };
  },
};
