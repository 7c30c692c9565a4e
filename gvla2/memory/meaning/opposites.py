"""Words that oppose one another, by axis: English, German, French, Spanish and Chinese; of Italian, Portuguese and
Russian the commonest. English forms with "-s", "-ed" and "-ing" are found by their stem.

A line is "axis: one side / other side"; a word stands on the first axis that has it.
"""

from __future__ import annotations

OPPOSITES = """
side: left leftward leftwards links linke linken linker linkes linkem gauche izquierda izquierdo 左 左边 左侧 左手
    左转 izq siniestra sinistra esquerda esquerdo слева влево налево левый левую 向左 左臂 / right rightward
    rightwards rechts rechte rechten rechter rechtes rechtem droite derecha derecho 右 右边 右侧 右手 右转 destra
    direita direito справа вправо направо правый правую 向右 右臂
height: above top up upper upward upwards over oben obere oberen oberer oberes oberhalb über aufwärts hinauf haut
    dessus arriba encima 上 上方 上面 overhead uppermost topmost highest ontop obenauf au-dessus sobre вверх наверх
    сверху 上部 顶部 上层 向上 往上 cima bovenaan / below bottom down downward downwards under underneath beneath unten
    untere unteren unterer unteres unterhalb unter abwärts hinunter bas dessous abajo debajo 下 下方 下面 lowest
    undermost bottommost underside drunter darunter au-dessous вниз внизу снизу 下部 底部 下层 向下 往下 baixo onderaan
depth: front forward forwards vorn vorne vorwärts devant delante adelante 前面 前方 前 foremost vorderseite вперёд
    вперед frontal 前进 向前 往前 / back backward backwards behind rear rearward hinten rückwärts derrière arrière
    detrás atrás 后面 后方 后 rearwards reverse reversed hinter rückseite trasero назад позади 后退 向后 往后 倒退
inside: inside into indoors innen hinein dedans dentro adentro 里面 内 inner innermost interior internal innere
    inneren innerer inneres intérieur interno 里 内部 内侧 / outside outdoors aussen draussen hinaus dehors fuera
    afuera 外面 外 outer outermost exterior external äussere äusseren äusserer äusseres extérieur externo 外部 外侧
turning: clockwise uhrzeigersinn horaire horario 顺时针 cw rightwise rechtsherum uhrzeigersinns dextrogyre orario
    顺时针方向 / counterclockwise anticlockwise counter-clockwise anti-clockwise gegenuhrzeigersinn antihoraire
    antihorario 逆时针 ccw widdershins linksherum antiorario sinistrogyre 逆时针方向 反时针
opening: open opens opened opening öffne öffnen öffnet geöffnet aufmachen offen ouvre ouvrez ouvrir ouvert ouverte
    abre abrir abra abierto abierta 打开 张开 开启 敞开 reopen öffnend geöffnete geöffneten geöffneter offene
    offenen offener ouverts ouvertes ouvrant abiertos abiertas abran abrid abrirlo abrirla abriendo apri aprire
    aperto aperta aberto открой открыть откройте открыт открытой открытым 开 打開 開 张开着 拉开 敞开着 / close closes
    closed closing shut shuts schliesse schliessen schliesst geschlossen zumachen ferme fermez fermer fermé fermée
    cierra cerrar cierre cerrado cerrada 关闭 合上 闭合 关上 关好 reclose shutting schliessend geschlossene
    geschlossenen geschlossener fermés fermées fermant cerrados cerradas cierren cerrarlo cerrarla cerrando chiudi
    chiudere chiuso chiusa feche fechar fechado закрой закрыть закройте закрыт закрытой закрытым 关 閉 闭上 关紧 合拢
    拉上
moving: push pushes pushed pushing shove drücke drücken schiebe schieben schiebt poussez pousser pousse empuja
    empujar empuje 推 drückt geschoben gedrückt poussé empujad empujen empujarlo empujando spingi spingere empurre
    empurrar толкай толкать 推动 推入 推开 / pull pulls pulled pulling drag tug ziehe ziehen zieht tirez tirer jala
    jalar tirar 拉 拽 haul yank gezogen herausziehen tiré tirant tira tiran jale hala tirarlo tirando puxe puxar
    tirare тяни тянуть 拉动 拉出 往外拉
power: energise energised energize energized
    enable enabled enables enabling activate activated active einschalten anschalten eingeschaltet aktivieren
    aktiviere aktiviert allumez allumer allume activer activez enciende encender activa activar 启用 开灯 激活
    打开电源 reenable switched-on einzuschalten angeschaltet aktivierte aktiv allumé allumée allumés activé activée
    actif encendido encendida encendidos activado activada activo 开着 通电 开机 已启用 启动电源 / disable disabled
    disables disabling deactivate deactivated inactive ausschalten abschalten ausgeschaltet deaktivieren deaktiviere
    deaktiviert éteignez éteindre éteins désactiver désactivez apaga apagar desactiva desactivar 禁用 关灯 停用 关掉
    deactivating deactivates deaktivierte inaktiv éteint éteinte éteints désactivé désactivée inactif apagado
    apagada apagados desactivado desactivada inactivo 断电 关机 已禁用 熄灭 关着
running: start starts started starting begin launch resume starte starten gestartet démarrez démarrer démarre inicia
    iniciar arranca arrancar 启动 开始 begins boot booting boots resumes resumed resuming commence commencer
    commencez gestartete anfangen beginnen beginne beginnt empieza empezar comienza comenzar arranque / stop stops
    stopped stopping halt terminate kill pause stoppe stoppen anhalten beenden arrêtez arrêter arrête detén detener
    parar termina 停止 终止 halts halted halting terminates terminated terminating kills killed pausing paused
    pauses abort aborts shutdown suspend suspended quit gestoppt stopp beendet beende abbrechen stopper stoppez
    arrêté pararse detenga detente interrumpe 停 暂停 结束 中止 关停
amount: increase increases increased increasing more larger greater erhöhe erhöhen vergrössern mehr augmentez
    augmenter aumenta aumentar más 增加 增大 提高 加大 enlarge enlarged steigern steigere steigert erhöht
    vergrössere augmenté 增多 调高 调大 boost amplía / decrease decreases decreased decreasing reduce reduces
    reduced reducing fewer less smaller verringere verringern reduziere reduzieren weniger réduisez réduire diminuez
    diminuer moins reducir disminuye disminuir menos 减少 减小 降低 lessen diminish verkleinern verkleinere réduit
    réduite reduzca reduciendo 减低 调低 调小 缩小
vertical: lift lifts lifted lifting raise raises raised raising elevate hebe heben hebt anheben hochheben gehoben
    soulève soulevez soulever levez levanta levantar levante 抬高 抬起 举起 提起 升高 hoist elevates elevated
    elevating uplift hochhebe hochgehoben angehoben hebend relever relevez soulevé levé levée alza alzar eleva
    elevar sollevare alzare подними поднять 抬 举 升起 上升 提升 higher / lowers lowered lowering senke senken
    absenken gesenkt senkt abaissez abaisser baissez baisser baja bajar 放下 降下 下放 lower herunterlassen
    herablassen absenke heruntergelassen abaissé baissé baisse baje abbassare abaixe опусти опустить 降 落下 放低
speed: fast quick quickly rapidly swiftly faster speedy schnell schneller rasch vite rapidement rapide rápido
    rápidamente deprisa 快 快速 迅速 rapid swift speedily zügig eilig flott rapides rapida rápidos veloz velozmente
    aprisa veloce velocemente depressa быстро 快点 高速 尽快 / slow slowly slower langsam langsamer lentement lent
    despacio lentamente lento 慢 缓慢 慢慢 慢速 langsame langsamen lente lentes lenta devagar медленно 慢点 低速
    缓缓
force: hard hart fest firmly forcefully strongly kräftig fortement fermement fuerte firmemente 用力 forceful
    vigorously starke starken starker feste festen fester vigoureusement fuertemente con-fuerza 使劲 大力 牢牢 紧紧
    tightly / soft softly weich gently lightly sanft doucement suavemente 轻轻 轻 delicately weakly mild softer
    weiche weichen weicher behutsam délicatement légèrement mollement delicadamente ligeramente suave dolcemente
    轻柔 温柔 轻放 faible loosely
level: high hoch hohe hoher hohes hohen haute alto alta 高 hohem höchste 高处 / low niedrig niedrige niedriger
    niedriges tief basse 低 niedrigem 低处
heat: hot warm heated heat heats heating heiss heissem heisses heissen warmes warmem chaud chaude caliente 热 加热
    preheat preheated warming warmed wärmen erwärmen erhitzen erhitze erhitzt heizen warme warmen chauffer chauffez
    chauffé réchauffer calentar calienta calentado calientes tibia 热的 加温 预热 / cold cool cooled chill chilled
    chills cooling kalt kaltem kaltes kalten kühl kühlen froid froide frío fría 冷 冷却 precool chilling refrigerate
    refrigerated gekühlt abkühlen kühle kalte abkühlt refroidir refroidissez refroidi froids enfriar enfría enfriado
    fríos 冷的 降温 冷藏
wetness: wet moist nass feucht mouillé humide mojado húmedo 湿 wetted damp dampened moisten moistened soak soaked
    nasse nassen nasser befeuchten anfeuchten feuchte feuchten mouillée mouiller humidifier humides mojada mojar
    humedecer húmeda 湿的 弄湿 潮湿 浸湿 dampen / dry dried trocken trockenes sèche seco seca 干 dries drying
    trockene trockenen trockener trocknen trockne sec secs sèches sécher secar seque secos 干燥 干的 擦干 晾干
filling: full fill filled voll füllen plein pleine lleno llena 满 fills filling refill füllt befüllen befülle
    gefüllt remplir remplissez remplie rempli llenar llene llenado 装满 灌满 加满 填满 / empty emptied drain leer
    leere leeren vide vider vacío vacía vaciar 空 empties emptying drains drained draining evacuate entleeren
    entleere entleert leert vidanger videz vidé vidée vacíe vaciado 清空 倒空 排空 空的
tension: tighten tightens tightened tight festziehen anziehen serrez serrer aprieta apretar 拧紧 收紧 snugly snug
    spannen spanne gespannt straff anziehst festgezogen tendu serré serrée serre resserrer aprietan apriete apretado
    tensa tensar 绷紧 紧固 旋紧 fastens / loosen loosens loosened loose lösen lockern desserrez desserrer afloja
    aflojar 拧松 松开 looser loosening slack slacken lockere locker losem gelockert desserré desserre détendre flojo
    afloje aflojado 放松 旋松 lâche löse löst gelöst
locking: lock locks locked locking verriegeln abschliessen verrouillez verrouiller bloquea bloquear 锁定 锁上 relock
    verriegle verriegelt abgeschlossen sperren sperre gesperrt verrouillé verrouille verrouillée bloqueado bloquee
    上锁 锁紧 锁住 / unlock unlocks unlocked unlocking entriegeln aufschliessen déverrouillez déverrouiller
    desbloquea desbloquear 解锁 entriegle entriegelt aufgeschlossen entsperren entsperrt déverrouillé déverrouille
    desbloqueado desbloquee 开锁 解除锁定
joining: attach attached connect connected join mount mounted plug assemble verbinde verbinden anschliessen
    montieren attachez attacher connectez connecter branchez monter conecta conectar montar 连接 安装上 挂载
    attaching attaches connecting connects joins joined plugged assembled assembling linked couple coupled bind
    fasten fastened verbunden verbindet angeschlossen montiere montiert zusammenbauen koppeln befestigen befestige
    attaché connecté branché branche montez monte assembler assemblez conectado conecte monta montado enchufa
    enchufar ensambla 装上 接上 插上 连上 组装 固定 绑定 link / detach detached disconnect disconnected separate
    unmount unmounted unplug disassemble dismount trenne trennen demontieren détachez détacher déconnectez
    déconnecter débranchez démonter desconecta desconectar desmontar 断开 拆下 卸载 detaching detaches disconnecting
    disconnects separated separating unplugged disassembled disassembling decouple decoupled uncouple unlink unbind
    unfasten unfastened unhook unmounting dismounted getrennt trennt demontiere demontiert zerlegen abkoppeln
    abnehmen détaché déconnecté débranche démontez démonte désassembler desconectado desconecte desmonta desmontado
    desenchufa desenchufar 拔下 拔掉 拆卸 拆开 分开 分离 解绑
allowing: allow allows allowed permit permits permitted accept erlaube erlauben zulassen autorisez autoriser
    permettre permite permitir 允许 接受 allowing permitting permissible grant granted erlaubt zulässig gestatten
    gestattet autorisé autorisée permis permise permitido permitida permitidos autorizado autorizada 准许 approve
    approved genehmigen approuver aprobar 批准 approves approving accepts accepted accepting agree agreed genehmige
    genehmigt annehmen annehme akzeptieren akzeptiere accepter acceptez approuvez aceptar acepta acepte apruebe
    aprueba 通过 / forbid forbids forbidden deny denies denied prohibit reject verbiete verbieten ablehnen interdire
    interdisez prohíbe prohibir 拒绝 forbidding forbade denying prohibited prohibits ban banned bans disallow
    disallowed illegal revoke revoked verboten untersagt untersagen unzulässig interdit interdite interdits défendu
    prohibido prohibida prohibidos deniega 不允许 refuse refused refuser rechazar rejects rejected rejecting
    declines decline declined refuses veto dismiss abgelehnt lehne zurückweisen rejeter rejetez rejette refusez
    rechaza rechace 驳回 拒收
including: include includes included including einschliessen inclure incluez incluye incluir 包括 包含 enthalten
    einbeziehen inclus incluse incluido incluida incluya / exclude excludes excluded excluding ausschliessen exclure
    excluez excluye excluir 排除 omit omitted ausgeschlossen ausnehmen exclu exclue excluido excluida excluya 不包括
    剔除
installing: install installs installed installing installiere installieren installez installer instala instalar 安装
    installiert installé installe instalado instale 装 / uninstall uninstalls uninstalled deinstalliere
    deinstallieren désinstallez désinstaller desinstala desinstalar uninstalling deinstalliert désinstallé
    désinstalle desinstalado desinstale 卸
adding: add adds added adding insert inserts inserted append füge hinzufügen zugeben ajoutez ajouter ajoute insérez
    añade añadir agrega agregar inserta 添加 加入 插入 inserting appended appending prepend introduce einfügen
    einsetzen eingesetzt hinzugefügt einlegen insérer insère inséré ajouté ajouts añadido agregado agregue insertar
    inserte introduzca introducir 放入 放进 插进 装入 新增 / remove removes removed removing delete deletes deleted
    deleting extract withdraw entferne entfernen löschen lösche retirez retirer supprimez supprimer quita quitar
    elimina eliminar retira 移除 删除 取出 去掉 removal extracted extracting withdrawn withdraws withdrew erase
    erased eject ejected gelöscht herausnehmen herausgenommen entnehmen entnimm enlever enlevez enlève retiré
    extraire extrayez supprimé supprime ôter eliminado elimine extrae extraer extraiga borra borrar saca sacar saque
    拿掉 拿出 抽出 删掉 拔出 entfernt
order: ascending aufsteigend croissant ascendente 升序 ascendant aufsteigende aufsteigender aufsteigendem steigend
    croissante croissants ascendentes creciente 递增 从小到大 / descending absteigend décroissant descendente 降序
    descendant absteigende absteigender absteigendem fallend décroissante descendentes decreciente 递减 从大到小
axis: vertical vertically senkrecht verticalement verticalmente 垂直 竖直 vertikal vertikale vertikalen senkrechte
    senkrechten lotrecht verticale verticaux verticales 垂直地 竖着 纵向 竖 / horizontal horizontally waagerecht
    waagrecht horizontalement horizontalmente 水平 waagrechte waagerechte horizontaux horizontales 水平地 横着 横向
    横
sequence: parallel parallelly concurrently simultaneously gleichzeitig parallèle simultáneamente paralelo 并行 同时
    concurrent simultaneous parallele parallelen parallelem simultané simultanément simultanée parallèlement
    concurrente simultáneo paralela 并发 并联 / sequential sequentially serially serial nacheinander
    séquentiellement secuencialmente 顺序 依次 串行 inseries sequentiell sequenziell sequenzielle sequentielle série
    séquentielle séquentiel secuencial consecutivamente sucesivamente 逐个 依序 串联 一个接一个
timing: synchronous synchronously synchron sync synchronised synchronized synchrone synchronen synchronem
    synchronement synchronisch sincrónico síncrono síncrona sincrónicamente 同步 / asynchronous asynchronously
    asynchron async asynchrone asynchronen asynchronem asynchroner asíncrono asíncrona asincrónico asincrónicamente
    异步
truth: true yes wahr vrai verdadero 真 wahre vraie verdadera / false falsch faux falso 假 falsche fausse falsa
case: uppercase grossbuchstaben majuscules mayúsculas upper-case capital capitals capitalised grossschreibung
    majuscule mayúscula 大写 / lowercase kleinbuchstaben minuscules minúsculas lower-case kleinschreibung minuscule
    minúscula 小写
indent: tab tabs tabulatoren / spaces leerzeichen
distance: near nahe proche près cerca 近 靠近 nearby nearer nearest nah nahen naher nähe proches cercano cercana
    cercanos 附近 closer closest / far away weit loin lejos 远 远离 farther farthest distant ferne fern éloigné
    éloignée lejano lejana lejanos 远处
lateness: early earlier früh früher tôt temprano 早 earliest frühe frühen früheren frühzeitig précoce temprana
    pronto 提早 提前 尽早 / late later spät später tard tarde 晚 latest späte späten spätestens tardif tardía 推迟
    延后 晚些
keeping: preserve retain behalten conserver conservar 保留 preserved preserving retained saves save saved saving
    aufbewahren behalte garder gardez sauvegarder enregistrer enregistrez guardar guarda guarde conserve 保存 留着 /
    discard dispose verwerfen entsorgen jeter desechar 丢弃 discards discarded discarding disposed scrap scrapped
    throwaway wegwerfen wegschmeissen verwirf jetez jette desecha deseche descartar descarta 扔掉 抛弃 舍弃
locality: local locally lokal onsite on-site localhost lokale lokalen lokaler localement locaux locales localmente
    本地 / remote remotely global globally offsite remotes globale globalement globalmente 远程 全局
visibility: public öffentlich publique público publicly öffentliche öffentlichen publics publiques públicos pública
    公开 公共 / private privat privée privado privately privaten privés privada privados 私有 私密
tilt: straight gerade droit recto 直 geraden gerader droits droites recta 笔直 / crooked schräg incliné inclinado
    倾斜 slanted inclined oblique schräge schrägen schief geneigt gekippt inclinée incliner penché inclinada torcido
    歪 斜 倾斜的 bent
flow: encrypt encrypted verschlüsseln chiffrer cifrar 加密 encrypts encrypting verschlüssele verschlüsselt chiffré
    chiffrez cifrado cifra cifre encode / decrypt decrypted entschlüsseln déchiffrer descifrar 解密 decrypts
    decrypting entschlüssele entschlüsselt déchiffré déchiffrez descifrado descifra descifre 解码 decode
packing: compress compressed zip pack komprimieren comprimir 压缩 compressing zipped packing einpacken packe
    verpacken empaquetar empaqueta 打包 包装 packed / decompress uncompressed unzip unpack entpacken descomprimir
    解压 decompressed unzipped unpacked unpacking auspacken desempaquetar desempaqueta 拆包 拆封 解包
covering: cover covered bedecken couvrir cubrir 盖上 covering covers bedecke abdecken abgedeckt zudecken couvert
    couvre recouvrir cubierto tapar 盖好 遮住 / uncover uncovered aufdecken découvrir destapar 揭开 uncovering
    uncovers exposed expose aufgedeckt découvert destapa destape descubierto 掀开
size: big large gross grosse grossen grand grande gran grandes 大 bigger biggest largest huge grosser grosses
    grösste grössten 大的 大号 / small little klein kleine kleinen petit petite pequeño pequeña 小 smallest tiny
    kleiner kleines kleinste kleinsten petits petites pequeños pequeñas 小的 小号
load: load loads loaded laden charger cargar loading beladen belade lade geladen chargez cargue 装载 加载 / unload
    unloads unloaded entladen décharger descargar unloading offload entlade abladen déchargez décharge descargue
    卸货
light: bright clair claro 亮 brighter brighten brightly hell helle hellen heller claire lumineux brillante clara
    iluminado 明亮 调亮 / dark dunkel sombre oscuro 暗 darker darken dim dimmed dunkle dunklen dunkler verdunkeln
    sombres obscur oscura oscurecer 昏暗 调暗 暗的
thickness: thick épais grueso 厚 thicker thickly dicke dicken dicker dick épaisse gruesa gruesos 厚的 / thin dünn
    fino 薄 thinner thinly dünne dünnen dünner delgado delgada 薄的
length: long longue largo 长 longer longest lange langen langer lang longues larga largos 长的 lengthen / short kurz
    kurze courte corto 短 shorter shortest shorten kürzer kürzeste kurzen kurzer courts courtes corta cortos 短的
holding: grasp grab grip gripping clasp hold held seize clutch pinch catch caught greife greifen greift gegriffen
    gegriffene halte halten hält gehalten festhalten ergreifen fassen fasse saisir saisissez saisis saisie attraper
    attrapez tenir tenez tiens tenu agripper agarra agarrar agarre agarrado coge coger coja sujeta sujetar sujete
    sostén sostener sostenga afferra afferrare segure segurar pegue возьми схвати держи 抓 抓住 抓取 握住 握紧 拿起
    拿住 夹住 捏住 acquire / release letgo ungrasp loslassen losgelassen freigeben freigegeben relâcher relâchez
    relâche lâcher lâchez libérer libérez suelta soltar suelte liberar libera libere rilascia lasciare solte отпусти
    松手 放手 释放 松开夹爪 放开 drop drops dropped dropping
reaching: extend extended extending elongate protract stretch stretched stretching ausfahren ausgefahren ausstrecken
    strecke strecken gestreckt ausklappen aufklappen étendre étendez étends étendu extiende extender extienda
    extendido estira estirar 伸出 伸展 伸开 伸长 / retract retracted retracting retraction einfahren eingefahren
    einziehen eingezogen einklappen zusammenklappen rétracter rétractez rétracté replier repliez retrae retraer
    retraiga retraído repliega 缩回 收回 收缩 收起
showing: show shown reveal revealed visible unhide unhidden zeige zeigen anzeigen angezeigt einblenden sichtbar
    affiche afficher affichez montrer montrez muestra mostrar muestre mostra 显示 露出 展示 / hide hides hid hidden
    hiding conceal concealed invisible verstecken verbergen verborgen ausblenden unsichtbar masquer masquez cacher
    cachez oculta ocultar oculte esconde esconder nascondi 隐藏 遮盖
spreading: expand expanded expanding dilate spread erweitern erweitere ausdehnen élargir expande expandir ampliar
    扩大 扩展 加宽 expansion / shrink shrunk constrict verengen schrumpfen rétrécir contrae contraer encoger 收窄
    变窄 collapse collapses collapsed collapsing contract contracts contracted
engaging: engage engaged engaging einrasten einkuppeln enclencher enclenchez embrayer engancha enganchar acopla
    acoplar 啮合 接合 / disengage disengaged disengaging ausrasten auskuppeln désenclencher débrayer désengager
    desengancha desenganchar desacopla desacoplar 脱开 脱离
inward: inward inwards einwärts vers-l'intérieur hacia-dentro 向内 往里 朝里 朝内 / outward outwards auswärts
    vers-l'extérieur hacia-fuera 向外 往外 朝外
stream: upstream stromaufwärts stromauf flussaufwärts vorgelagert amont aguas-arriba 上游 / downstream stromabwärts
    stromab flussabwärts nachgelagert aval aguas-abajo 下游
hillside: uphill bergauf 上坡 / downhill bergab 下坡
pinning: pin pinned pinning anheften fixieren fixiere fixiert épingler fija fijar / unpin unpinned unpinning
    loslösen désépingler desfija
freezing: freeze frozen froze freezing einfrieren eingefroren gefrieren geler congeler congelez congelé congela
    congelar congelado 冷冻 冻结 / thaw thawed unfreeze unfrozen thawing defrost defrosted auftauen aufgetaut
    dégeler décongeler décongelez décongelé descongela descongelar descongelado 解冻
compass: north northern northward northwards norden nördlich nord norte 北 北边 朝北 向北 / south southern southward
    southwards süden südlich süd sud 南 南边 朝南 向南
compass-ew: east eastern eastward eastwards osten östlich ost 东边 朝东 向东 / west western westward westwards
    westen westlich ouest oeste 西边 朝西 向西
driving: manual manually byhand manuell manuelle manuellen händisch manuel manuellement manualmente 手动 人工 手工 /
    automatic automatically auto automated automatisch automatische automatischen automatiquement automatique
    automático automática automáticamente 自动 automate
extent: halfway partly partially partial incompletely teilweise halbwegs halb partiellement partielle à-moitié
    parcialmente amedias 部分 一半 半开 incomplete / completely fully entirely wholly complete entire alltheway
    vollständig ganz komplett völlig gänzlich complètement entièrement totalement completamente totalmente
    enteramente 完全 全部 彻底 全开
sealing: sealed seal sealing airtight abdichten abgedichtet versiegelt versiegeln dicht verschlossen sceller scellé
    scellée étanche hermétiquement sellar sellado sellada hermético 密封 封好 密闭 / unsealed unseal leaky undicht
    unversiegelt descellé descellée desellado 未密封 开封
posture: upright erect rightsideup aufrecht stehend aufrechte droit-debout debout erguido erguida depie 直立 竖立
    立着 正放 / upsidedown inverted headfirst kopfüber aufdemkopf à-l'envers àlenvers renversé invertido invertida
    volcado 倒置 倒放 颠倒 倒扣 umgekehrt
facing: faceup 朝上 正面朝上 面朝上 bocaarriba face-up / facedown face-down 朝下 正面朝下 面朝下 bocaabajo
advancing: advance vorrücken vorfahren avancer avancez avance avanza avanzar 前移 / retreat retreats retreated
    retreating recede zurückziehen zurückfahren zurückweichen reculez recule retroceder retrocede retroceda 撤离
    撤回 退回 reculer
entering: enter enters entering entered ingress betreten eintreten hineinfahren entrer entrez entrar 进入 / exits
    leave-out hinausfahren sortir sortez salir 离开 退出
muting: mute muted muting silence silent stumm stummschalten lautlos muet silencieux silencia silenciar silencio
    静音 / unmute unmuted unmuting 取消静音
loudness: loud louder loudly noisy laut lauter bruyant 大声 响 / quiet quieter quietly leise leiser silencioso 小声
    安静
safety: safe harmless sicher ungefährlich unbedenklich sûr inoffensif seguro segura inofensivo 安全 无害 / dangerous
    unsafe hazardous harmful gefährlich unsicher schädlich dangereux dangereuse nocif peligroso peligrosa inseguro
    nocivo 危险 不安全 有害
need: necessary required mandatory compulsory obligatory nötig notwendig erforderlich pflicht obligatorisch
    nécessaire obligatoire requis necesario necesaria obligatorio obligatoria requerido 必要 必须的 必需 /
    unnecessary optional superfluous needless unneeded unnötig überflüssig optionale inutile facultatif facultative
    superflu innecesario innecesaria opcional facultativo 不必要 可选 多余
validity: valid correct correctly gültig korrekt zulässige valide válido válida correcto correcta 有效 正确 /
    invalid incorrect incorrectly wrong ungültig inkorrekt invalide incorrecte inválido inválida incorrecto
    incorrecta 无效 错误的 不正确
sharpness: sharp sharpen sharpened scharf scharfe aiguisé tranchant afilado afilada 锋利 / blunt dull stumpf stumpfe
    émoussé desafilado romo 钝
smoothness: smooth smoothly glatt glatte lisse liso lisa 光滑 平滑 / bumpy rau raue rugueux rugueuse rugoso áspero
    粗糙 rough roughen
grain: coarse coarsely coarser grob grobe groben grober grobkörnig grossier grossière grossièrement basto tosco 粗
    粗略 / finely finer fein feine feinen feiner feinkörnig finement finamente 细 精细 fine
width: wide wider widely widest broad breit breiten breiter larges ancho ancha anchos 宽 widen widened / narrow
    narrower narrowly schmal schmale schmalen schmaler eng enge étroit étroite estrecho estrecha angosto 窄
depthwise: deep deeper profond profonde profondément profundo profunda 深 deeply / shallow shallower flach flache
    peuprofond superficiel poco-profundo superficial 浅 shallowly
stiffness: stiff rigid stiffly steif starr rigide raide rígido rígida tieso 刚性 僵硬 / flexible compliant pliable
    nachgiebig biegsam souple dócil 柔顺 柔性
steadiness: steady stable steadily stabil estable 稳定 平稳 / shaky unstable wobbly jerky instabil wackelig instable
    inestable 不稳 晃动 jerkily unsteady
strictness: strict strictly streng strikt strictement estricto estricta estrictamente 严格 / lenient relaxed
    permissive lax lasch laxiste permisivo 宽松 leniently
access: readonly nurlesend 只读 / writable readwrite beschreibbar 可写
graph: static statically statisch statique estático estática 静态 / dynamic dynamically dynamisch dynamique dinámico
    dinámica 动态
versioning: upgrade upgrades upgraded upgrading 升级 mettreàniveau / downgrade downgrades downgraded downgrading
    降级
pushing: upload uploads uploaded uploading hochladen hochgeladen téléverser 上传 / download downloads downloaded
    downloading herunterladen heruntergeladen runterladen 下载
zooming: zoomin hineinzoomen 放大 / zoomout herauszoomen
logging-in: login logon einloggen anmelden 登录 / logout logoff signout ausloggen abmelden 登出 注销
merging: merge merged merging zusammenführen fusionner fusiona fusionar 合并 / split splits splitting divide divided
    aufteilen scinder diviser dividir 拆分 分割
linking: subscribe subscribed abonnieren abonner 订阅 / unsubscribe unsubscribed abbestellen désabonner 退订
registering: register registered 注册 / unregister unregistered deregister deregistered deregistrieren
dressing: puton aufsetzen 戴上 穿上 wear / takeoff 摘下 脱下
singular: onehanded single-handed einhändig einarmig 单臂 unimanual 一只手 / twohanded bimanual bimanually
    beidhändig zweihändig beidarmig bimanuel 双臂 两只手
sobriety: positive positiv positif positivo / negative negativ négatif negativo
charging: charge charged charging aufladen auflade aufgeladen recharger rechargez recarga recargar 充电 / discharge
    discharged discharging 放电
blocking: blocked blockieren bloquer / unblock unblocked unblocking débloquer
weights: heavy heavier heavily schwere schweren schwerer lourd lourde lourds pesado pesada pesados 重 / lightweight
    lighter léger légère ligero ligera 轻的
ripeness: raw roh crudo 生的 / cooked gekocht cuit cocido 熟的
freshness: fresh frisch frais fresco 新鲜 / stale rotten abgestanden rassis périmé rancio 不新鲜
newness: new newer newest neu neue neuen neuer nouveau nouvelle nouvel nuevo nueva 新 新的 / old older oldest alt
    alte alten vieux vieille ancien ancienne viejo vieja antiguo 旧 旧的
acid: acidic acide ácido / alkaline alkalisch alcalin alcalino
docking: dock docked docking andocken / undock undocked undocking abdocken
screwing: screw-in screwin einschrauben eingeschraubt anschrauben festschrauben visser vissez atornilla atornillar
    拧上 拧入 / unscrew unscrews unscrewed unscrewing herausschrauben abschrauben losschrauben dévisser dévissez
    desatornilla desatornillar 拧下 拧开 旋开
tying: tie tied tying festbinden nouer atar ata 绑 系上 / untie untied untying losbinden aufbinden dénouer desatar
    desata 解开
buckling: buckle buckled anschnallen abrocha abrochar / unbuckle unbuckled abschnallen déboucler desabrocha
    desabrochar
stacking: stack stacked stacking stapeln staple gestapelt empiler empilez apilar apila 堆叠 叠放 / unstack unstacked
    destack entstapeln dépiler désempiler desapilar desapila 拆垛
winding: aufwickeln enrouler enrolla enrollar 卷起 缠绕 wind wound roll rolled / unwind unwound uncoil abwickeln
    dérouler desenrolla desenrollar unroll unrolled
folding: fold folds folded folding crease refold plier pliez pliée falten falte gefaltet zusammenfalten pliega
    plegar pliegue dobla doblar doble 折叠 对折 叠好 / unfold unfolds unfolded unfolding entfalten déplier dépliez
    dépliée desdobla desdoblar 摊开 despliega desplegar despliegue 展开 déployer déployez
wrapping: wrap wraps wrapped wrapping einwickeln emballer emballez envolver envuelve 包裹 包起 / unwrap unwraps
    unwrapped unwrapping auswickeln déballer déballez desenvolver desenvuelve 拆开包装
clamping: clamp clamped clamping festklemmen klemme einklemmen clip clipped 夹紧 / unclamp unclamped unclamping
    unclip unclipped ausklemmen
inflating: inflate inflated inflating aufblasen aufpumpen gonfler gonflez gonflé inflar infla infle 充气 / deflate
    deflated deflating dégonfler dégonflez desinflar desinfla 放气
committing: commit commits committed committing 提交 / revert reverts reverted reverting rollback rolledback undo
    undone rückgängig revertir revierte deshacer 回滚 撤销
checking: select selected tick ticked auswählen ausgewählt cocher cochez marca marcar 勾选 选中 / deselect
    deselected untick unticked uncheck unchecked abwählen décocher décochez desmarca desmarcar 取消勾选 取消选中
cleaning: clean cleanly sauber saubere sauberen propre propres limpio limpios 干净 / dirty soiled filthy messy
    schmutzig schmutzige schmutzigen dreckig verschmutzt sucio sucia sucios sale 脏
presence: present anwesend vorhanden présent presente 存在 / absent missing abwesend fehlend ausente 缺失
connection: online en-ligne 在线 联网 / offline hors-ligne 离线
price: expensive costly teuer cher coûteux caro 贵 / cheap inexpensive billig günstig barato 便宜
chance: deterministic deterministically deterministisch déterministe determinista 确定性 / random randomly
    stochastic zufällig aléatoire aleatorio aleatoriamente 随机
clearness: transparent translucent durchsichtig transparente 透明 / opaque undurchsichtig opaco 不透明
duration: temporarily temporary vorübergehend temporär temporaire temporairement temporal temporalmente 临时 暂时 /
    permanently permanent dauerhaft ständig permanente permanentemente définitivement 永久
company: together jointly zusammen gemeinsam ensemble juntos juntas junto 一起 共同 / separately individually apart
    einzeln séparément individuellement aparte separado individualmente 分别 单独
extremes: minimise minimize minimieren minimiser minimizar 最小化 / maximise maximize maximieren maximiser maximizar
    最大化
sharing: shared partagé compartido 共享 / exclusive exclusively exklusiv exclusif exclusivo 独占
verbosity: verbose verbosely ausführlich verbeux detallado 详细 / terse concise knapp concis conciso 简略
accelerating: accelerate accelerates accelerated accelerating beschleunigen beschleunige accélérer accélérez accélère
    acelerar acelera 加速 / decelerate decelerates decelerated decelerating slowed slowing verlangsamen verlangsame
    ralentir ralentissez ralentis ralentit desacelerar frenar frena 减速
bending: straighten straightened unbend begradigen redresser enderezar endereza 弄直 / bend bends bending biegen
    biege gebogen courber 弯曲
strength: strong strengthen 强 / weak weaken schwach débil 弱
eagerness: eager eagerly / lazy lazily
ground: foreground vordergrund / background hintergrund 后台
daytime: day daytime tagsüber 白天 / night nighttime nachts 夜间 夜里
lengthwise: lengthwise lengthways längs / crosswise crossways widthwise quer
trading: import imported importieren importer importar 导入 / export exported exportieren exporter exportar 导出
curving: convex konvex convexe convexo / concave konkav cóncavo
relation: absolute absolut absolu absoluto 绝对 / relative relativ relatif relativo 相对
"""
