// What is packed in the page, among it its own script.

// Take out what stands in the page as base64 of gzip.
export async function unpack(id) {
  const node = document.getElementById(id);
  const text = atob(node.textContent.trim());
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  node.remove();
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Run the page's script.
export async function begin() {
  if (typeof DecompressionStream === "undefined") {
    const text = "This page needs a browser of 2023 or newer.";
    document.getElementById("notice-text").textContent = text;
    document.getElementById("notice").classList.add("trouble");
    return;
  }
  const code = document.createElement("script");
  code.textContent = new TextDecoder().decode(await unpack("code"));
  document.body.append(code);
}
