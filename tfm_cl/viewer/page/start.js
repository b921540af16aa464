// The page of the web server: mounts the viewer on a WebSocket. The notebook's widget has a transport of its own.
{
  // The token came with the address; the cookie has it now, and the browser's history need not.
  if (location.search) history.replaceState(null, "", location.pathname);

  const RETRY = 1000; // milliseconds
  const listeners = { message: [], binary: [], state: [] };
  const tell = (kind, value) => listeners[kind].forEach((listener) => listener(value));

  // By this name the server finds the session again when the page is loaded again.
  let session = sessionStorage.getItem("tfm-session");
  if (!session) {
    session = crypto.getRandomValues(new Uint8Array(16)).reduce((text, byte) => text + byte.toString(16).padStart(2, "0"), "");
    sessionStorage.setItem("tfm-session", session);
  }

  let socket = null;
  const connect = () => {
    socket = new WebSocket(`ws://${location.host}/socket?session=${session}`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => tell("state", { connected: true, line: "" });
    socket.onmessage = ({ data }) => (typeof data === "string" ? tell("message", JSON.parse(data)) : tell("binary", data));
    socket.onclose = ({ reason }) => {
      tell("state", { connected: false, line: reason || "the viewer does not answer; trying again" });
      setTimeout(connect, RETRY);
    };
  };

  const transport = {
    send: (message) => socket?.readyState === WebSocket.OPEN && socket.send(JSON.stringify(message)),
    onMessage: (listener) => listeners.message.push(listener),
    onBinary: (listener) => listeners.binary.push(listener),
    onState: (listener) => listeners.state.push(listener),
    // Resolves to the path to open; rejects with a line.
    upload: async (file) => {
      const answer = await fetch(`/upload?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
      if (!answer.ok) throw new Error((await answer.text()).trim());
      return (await answer.json()).path;
    },
  };
  if (typeof mount === "function") mount(document.getElementById("viewer"), transport);
  connect();
}
