// What is dropped as one file: the folder of a bag is packed as `tar` does it, of which nothing is read before it is sent.

const BLOCK = 512;
const LONGEST = 100; // bytes of a name
const MOST = 1000; // files of one bag

/** The files of a drop, and the name of the folder that they are in, if any. It is to be asked for while the drop is told of. */
export async function dropped(transfer) {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  const files = [...transfer.files]; // which is empty once this has waited
  const folders = entries.filter((each) => each.isDirectory);
  if (!folders.length) return { files, folder: null };
  if (entries.length > 1) return { files: [], folder: null };
  return { files: await filesIn(folders[0]), folder: folders[0].name };
}

/** The files that lie in a folder itself. */
async function filesIn(folder) {
  const reader = folder.createReader();
  const entries = [];
  for (let more = [null]; more.length; entries.push(...more)) more = await new Promise((found, failed) => reader.readEntries(found, failed));
  return Promise.all(entries.filter((each) => each.isFile).map((each) => new Promise((found, failed) => each.file(found, failed))));
}

/** One file of a drop as it is, several, or those of a folder, as one; null where these are no recording. */
export function packed(files, folder) {
  const shown = files.filter(({ name }) => !name.startsWith("."));
  if (!folder && shown.length === 1) return shown[0];
  const bag = shown.some(({ name }) => name === "metadata.yaml");
  const short = shown.every(({ name }) => new TextEncoder().encode(name).length <= LONGEST);
  if (!shown.length || shown.length > MOST || !short || !(folder || bag)) return null;
  return new File([...shown.flatMap(member), new Uint8Array(2 * BLOCK)], `${folder ?? "bag"}.tar`);
}

function member(file) {
  const rest = (BLOCK - (file.size % BLOCK)) % BLOCK;
  return [header(file), file, new Uint8Array(rest)];
}

/** A member's header, as POSIX.1-1988 (ustar) has it. */
function header({ name, size }) {
  const bytes = new Uint8Array(BLOCK);
  const write = (text, at) => bytes.set(new TextEncoder().encode(text), at);
  const octal = (number, digits) => `${number.toString(8).padStart(digits, "0")}\0`;
  const fields = [[name, 0], [octal(0o644, 7), 100], [octal(0, 7), 108], [octal(0, 7), 116], [octal(size, 11), 124],
    [octal(0, 11), 136], [" ".repeat(8), 148], ["0", 156], ["ustar\0", 257], ["00", 263]];
  for (const [text, at] of fields) write(text, at);
  write(`${octal(bytes.reduce((sum, each) => sum + each, 0), 6)} `, 148);
  return bytes;
}
