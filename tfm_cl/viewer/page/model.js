// What the page knows of its session, and what it says to it.

const SETTLED = 2000; // milliseconds after which the session's word counts, whatever was said here

/** Whether a dotted key is another one, or of something in it. */
const isWithin = (key, whole) => key === whole || key.startsWith(`${whole}.`);

class Model {
  /**
   * `transport`: `send(message)`; `listen({ message, binary, state })`, which are called with what comes: a message, an
   * ArrayBuffer, { connected, line }; `upload(file, kind, tell)`, which tells the part that is sent and resolves to its path within the folder.
   */
  constructor(transport) {
    Object.assign(this, { transport, welcome: null, state: null, original: null, connected: false, line: "" });
    this.listeners = new Map();
    this.said = new Map(); // of keys, what was said here and is not in the state yet
    this.dragged = new Map(); // changes that the next frame of the screen sends
    this.waiting = null;
    this.dragging = false;
    transport.listen({
      message: (message) => this.#hear(message),
      binary: (data) => this.#hearPicture(data),
      state: ({ connected, line }) => {
        Object.assign(this, { connected, line });
        if (!connected) this.said.clear();
        this.#tell("connection");
      },
    });
  }

  /** Call back on a kind of message, or on "connection", "picture", "options". */
  on(kind, listener) {
    if (!this.listeners.has(kind)) this.listeners.set(kind, []);
    this.listeners.get(kind).push(listener);
  }

  #tell(kind, value) {
    for (const listener of this.listeners.get(kind) ?? []) listener(value);
  }

  send(message) {
    this.transport.send(message);
  }

  /** The scene as it is here: what the session says, and what was said since. */
  get options() {
    if (this.state === null) return null;
    this.merged ??= [...this.said].reduce((options, [key, { value }]) => {
      if (value === null) return options;
      // What stood in a matrix stands where it is said to be, and the other way round.
      const outdone = rivalsOf(key).filter((other) => valueAt(options, other));
      return outdone.reduce((left, other) => withValue(left, other, null), withValue(options, key, value));
    }, this.state.options);
    return this.merged;
  }

  /** Around what the session says that there is. */
  get extent() {
    return extentOf(this.state.bounds);
  }

  value(key) {
    return valueAt(this.options, key);
  }

  /** Keys that were set since the file was opened. */
  get edited() {
    return Object.keys(this.state?.edits ?? {});
  }

  /** Whether a key, or something in it, is not as the file says it. */
  isEdited(key) {
    if (this.canTakeBack(key)) return true;
    const isInSet = this.edited.some((edited) => isWithin(key, edited));
    return isInSet && (this.original === null || !same(valueAt(this.original, key), valueAt(this.state.options, key)));
  }

  /** Whether what was changed of a key can be taken back alone. */
  canTakeBack(key) {
    return this.edited.some((edited) => isWithin(edited, key));
  }

  /** Set keys. While something is dragged they are sent once for each frame of the screen. */
  edit(changes, drag = false) {
    if (this.state === null) return;
    for (const [key, value] of Object.entries(changes)) {
      this.said.delete(key); // what is said last counts
      this.said.set(key, { value, at: performance.now() });
      this.dragged.set(key, value);
    }
    this.merged = undefined;
    this.dragging = drag;
    if (!drag) this.#sendEdit();
    else this.waiting ??= requestAnimationFrame(() => this.#sendEdit());
    this.#tell("options");
  }

  /** What was dragged is where it shall be. */
  drop() {
    if (!this.dragging) return;
    this.dragging = false;
    if (this.dragged.size === 0 && this.last) this.dragged = new Map(Object.entries(this.last));
    this.#sendEdit();
  }

  /** Take changes back: keys are as the file says them. */
  takeBack(...keys) {
    const edited = this.edited.filter((one) => keys.some((key) => isWithin(one, key)));
    if (edited.length > 0) this.send({ type: "edit", changes: Object.fromEntries(edited.map((key) => [key, null])), drag: false });
  }

  #sendEdit() {
    if (this.waiting !== null) cancelAnimationFrame(this.waiting);
    this.waiting = null;
    if (this.dragged.size === 0) return;
    this.last = Object.fromEntries(this.dragged);
    this.dragged = new Map();
    this.send({ type: "edit", changes: this.last, drag: this.dragging });
  }

  #hear(message) {
    if (message.type === "welcome") this.welcome = message;
    if (message.type === "state") this.#hearState(message);
    if (message.type === "failed") this.#forget();
    this.#tell(message.type, message);
    if (["state", "failed"].includes(message.type)) this.#tell("options");
  }

  /** What was said here holds until the session says the same, so that nothing jumps back while it is dragged. */
  #hearState(state) {
    const before = this.state;
    this.state = state;
    if (before !== null && before.source !== state.source) this.#forget();
    if (Object.keys(state.edits).length === 0) this.original = state.options;
    else if (before?.source !== state.source) this.original = null;
    const now = performance.now();
    for (const [key, { value, at }] of this.said) {
      const isHeard = same(valueAt(state.options, key), value) && !this.dragging;
      if (isHeard || (now - at > SETTLED && !this.dragging)) this.said.delete(key);
    }
    this.merged = undefined;
  }

  #forget() {
    this.said.clear();
    this.merged = undefined;
  }

  #hearPicture(data) {
    const length = new DataView(data).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    this.#tell("picture", { header, bytes: new Uint8Array(data, 4 + length) });
  }
}
