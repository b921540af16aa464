// The page of the web server: mounts the viewer on a WebSocket. The notebook's widget has a transport of its own.
{
  // The token came with the address; the cookie has it now, and the browser's history need not.
  if (location.search) history.replaceState(null, "", location.pathname);

  const RETRY = 1000; // milliseconds

  // By this name the server finds the session again when the page is loaded again.
  const session = sessionStorage.getItem("tfm-session") ?? randomKey();
  sessionStorage.setItem("tfm-session", session);

  let [socket, heard] = [null, null];
  const connect = () => {
    socket = new WebSocket(`ws://${location.host}/socket?session=${session}`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => heard.state({ connected: true, line: "" });
    socket.onmessage = ({ data }) => (typeof data === "string" ? heard.message(JSON.parse(data)) : heard.binary(data));
    socket.onclose = ({ reason }) => {
      heard.state({ connected: false, line: reason || "the viewer does not answer; trying again" });
      setTimeout(connect, RETRY);
    };
  };

  mount(document.getElementById("viewer"), {
    send: (message) => socket?.readyState === WebSocket.OPEN && socket.send(JSON.stringify(message)),
    listen: (callbacks) => { heard = callbacks; },
    upload: async (file, kind) => {
      const answer = await fetch(`/upload?name=${encodeURIComponent(file.name)}&kind=${kind}`, { method: "POST", body: file });
      if (!answer.ok) throw new Error((await answer.text()).trim());
      return (await answer.json()).path;
    },
  });
  connect();
}
