// What the page carries as text: base64 of gzip, and base64 of numbers.

/** The bytes that base64 text stands for. */
export function decodeBytes(text) {
  const characters = atob(text.trim());
  const bytes = new Uint8Array(characters.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = characters.charCodeAt(i);
  return bytes;
}

/** Little-endian numbers of the type dtype, "float32" or "float64". */
export function decodeNumbers(text, dtype) {
  const { buffer } = decodeBytes(text);
  return dtype === "float64" ? new Float64Array(buffer) : new Float32Array(buffer);
}

/** The bytes that were compressed by gzip. */
export async function unzip(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}
